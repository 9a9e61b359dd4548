"""How long the robot has stood where it is, and whether it moves at all."""

from __future__ import annotations

import logging
from math import pi, remainder
from typing import Final

from common.geometry import Pose
from common.system.logs import lasting

log = logging.getLogger(__name__)

# Less than this is standing, metres and radians.
_MOVED: Final = (0.1, 0.2)
# A robot that has not moved in so many times of no progress was sent to more than one place, and none is at fault.
_UNMOVED: Final = 1.9


class Standing:
    """Follows the pose; times are seconds of one clock, given by the caller. Not thread-safe."""

    def __init__(self) -> None:
        """Know no pose yet."""
        self._since: tuple[float, Pose] | None = None

    def reset(self) -> None:
        """Begin to count anew: the robot was not to move."""
        self._since = None

    def seconds(self, now: float, pose: Pose | None) -> float:
        """Take in where the robot is, and return how long it has neither moved nor turned; 0 without a pose."""
        if pose is None:
            return 0.0
        since, there = self._since or (now, pose)
        turned = abs(remainder(pose.yaw - there.yaw, 2.0 * pi))
        if pose.distance_to(there.position) > _MOVED[0] or turned > _MOVED[1]:
            since, there = now, pose
        self._since = since, there
        return now - since


class MotionCheck:
    """Tells a robot that cannot move from one that finds no way; not thread-safe.

    Attributes:
        problem: why no place is to blame, for the operator; empty while the robot moves, or is not to.
    """

    def __init__(self, progress_time: float) -> None:
        """Know no pose yet; after so many seconds without progress one place is given up, and the next is tried."""
        self.problem = ""
        self._patience = _UNMOVED * progress_time
        self._standing = Standing()

    def reset(self) -> None:
        """Begin to count anew: the robot was not to move, or not by the bridge's will."""
        self._standing.reset()

    def take(self, now: float, pose: Pose | None) -> None:
        """Take in where the robot is, at a time in seconds."""
        if self._standing.seconds(now, pose) < self._patience:
            self.problem = ""
        elif not self.problem:
            self.problem = (
                "the robot does not move, wherever it is sent: is its stack inactive or in manual mode, does it reject "
                "its goals, are its motors off, is a stop pressed, or is it stuck?"
            )
            log.warning("%s", self.problem, extra=lasting(lambda: bool(self.problem)))
