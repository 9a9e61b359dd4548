"""Notice that the robot gets nowhere."""

from __future__ import annotations

from math import inf
from typing import Final

from deploy.config import Point, SafetyConfig

# Noise of the map makes small areas come and go, and small distances are drift.
_AREA_STEP: Final = 0.5
_DISTANCE_STEP: Final = 0.5
_GOAL_CELL: Final = 0.5


class ProgressMonitor:
    """The rule of `safety.progress_time`: no new area and no nearer goal for so long is no progress.

    A goal's nearest distance is remembered until there is new area, so that a robot that drives to and fro between
    two goals makes no progress either.

    Usage, at every decision of an active robot::

        if monitor.update(now, explored_area, goal, goal_distance):
            change_something()
            monitor.reset(now)
    """

    def __init__(self, config: SafetyConfig) -> None:
        self._seconds = config.progress_time
        self._area = -inf
        self._nearest: dict[tuple[int, int], float] = {}
        self._since: float | None = None

    def update(
        self, now: float, explored_area: float, goal: Point | None = None, goal_distance: float | None = None
    ) -> bool:
        """Take in where things stand, and say whether there has been no progress for too long.

        Args:
            now: seconds of a monotonic clock.
            explored_area: m2.
            goal: (x, y) that the robot is on its way to: the task's target, or the beacon or frontier of this moment.
            goal_distance: metres of path to it.
        """
        if self._since is None:
            self.reset(now)
        if explored_area >= self._area + _AREA_STEP:
            self._area = explored_area
            self._nearest.clear()
            self._since = now
        if goal is not None and goal_distance is not None:
            key = round(goal[0] / _GOAL_CELL), round(goal[1] / _GOAL_CELL)
            nearest = self._nearest.setdefault(key, goal_distance)
            if goal_distance <= nearest - _DISTANCE_STEP:
                self._nearest[key] = goal_distance
                self._since = now
        return self.stalled_for(now) >= self._seconds

    def stalled_for(self, now: float) -> float:
        """Seconds since the last progress."""
        return 0.0 if self._since is None else now - self._since

    def reset(self, now: float) -> None:
        """Start the time anew: at the start, after a pause, after a remedy."""
        self._since = now
        self._nearest.clear()
