"""Tasks: what the robot must do, on one environment core."""

from __future__ import annotations

from actors.tasks.base import Task
from actors.tasks.exploration import ExplorationTask
from actors.tasks.navigation import NavigationTask
from common.config.schema import TaskConfig

__all__ = ["ExplorationTask", "NavigationTask", "Task", "make_task"]


def make_task(config: TaskConfig) -> Task:
    """Return the task that a configuration names."""
    if config.name == "navigation":
        return NavigationTask(config.arrival_radius)
    return ExplorationTask(config.unseen_area)
