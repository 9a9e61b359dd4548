"""Planners that drive to a target, and what only they need."""
