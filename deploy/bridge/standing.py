"""How long the robot has stood where it is."""

from __future__ import annotations

from math import pi, remainder
from typing import Final

from common.geometry import Pose

# Less than this is standing, metres and radians.
_MOVED: Final = (0.1, 0.2)


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
