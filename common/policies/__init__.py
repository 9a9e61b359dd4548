"""Policies that act: as objects, as files, and the ones that ship."""
