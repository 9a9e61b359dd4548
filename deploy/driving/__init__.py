"""The bridge's own local planner: a path and obstacles in, a velocity within the robot's limits out."""

from deploy.driving.planner import Command, LocalPlanner

__all__ = ["Command", "LocalPlanner"]
