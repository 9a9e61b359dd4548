"""The contract of a goal: when a task is complete, and how far it has come."""

from __future__ import annotations

from typing import Protocol

from actors.maps.grid_map import GridMap
from actors.tasks.coverage import Coverage
from common.geometry import Pose
from common.tasks import Task


class Goal(Protocol):
    """The goal of an episode, judged on the true map.

    Usage::

        goal.reset(world)
        while not goal.complete(coverage, pose):
            ...
    """

    @property
    def task(self) -> Task:
        """The task whose goal it is."""
        ...

    @property
    def target(self) -> tuple[float, float] | None:
        """Position that the robot is given in advance, metres, or None."""
        ...

    def reset(self, world: GridMap) -> None:
        """Begin an episode in a world; raise MapError when the world does not suit the task."""
        ...

    def complete(self, coverage: Coverage, pose: Pose) -> bool:
        """Whether the goal is reached, given what was seen and where the robot stands."""
        ...

    def progress(self, pose: Pose) -> float:
        """Straight-line distance to the target, metres; 0 for a task without one."""
        ...
