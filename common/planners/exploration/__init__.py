"""Planners that explore, and what only they need."""
