"""Exploration: see everything that can be reached."""

from __future__ import annotations

from actors.maps.grid_map import GridMap
from actors.tasks.coverage import Coverage
from common.config import TaskConfig
from common.geometry import Pose
from common.tasks import EXPLORATION, Task


class ExplorationGoal:
    """Complete when at most ``unseen_area`` square metres of the reachable clear area are unseen."""

    target = None

    def __init__(self, config: TaskConfig, task: Task = EXPLORATION) -> None:
        self.task = task
        self.unseen_area = config.unseen_area

    def reset(self, world: GridMap) -> None:
        """Begin an episode; every world suits."""

    def complete(self, coverage: Coverage, pose: Pose) -> bool:
        """Whether little enough is left unseen; where the robot stands does not matter."""
        del pose
        return coverage.unseen_area <= self.unseen_area + 1e-9

    def progress(self, pose: Pose) -> float:
        """Return 0: there is no target."""
        del pose
        return 0.0
