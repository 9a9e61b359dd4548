"""Worlds: the public PNG maps, procedural generators and what makes maps alike."""
