"""Planners: what the robot knows goes in, the next waypoint comes out; learned and classical ones alike."""
