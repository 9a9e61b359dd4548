"""Goals: when a task is complete, judged on the true map, on one environment core. `common.tasks` has the tasks."""

from __future__ import annotations

from typing import cast

from actors.tasks.base import Goal
from actors.tasks.exploration import ExplorationGoal
from actors.tasks.navigation import NavigationGoal
from common.config import TaskConfig

__all__ = ["ExplorationGoal", "Goal", "NavigationGoal", "make_goal"]


def make_goal(config: TaskConfig) -> Goal:
    """Return the goal of the task that a configuration names."""
    task = config.kind
    return cast(Goal, task.part("goal")(config, task))
