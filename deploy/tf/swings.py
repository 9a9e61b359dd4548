"""Whether poses swing between two places: two publishers of one odometry or transform disagree."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from math import pi, remainder
from typing import Final

from common.geometry import Pose

# Steps there and back of more than this, metres or radians, are no motion of a robot on wheels.
_LEAST: Final = 0.2
# After a swing the pose is where it was two poses ago, but for so large a share of the way there.
_BACK: Final = 0.5
# So many swings within so many seconds; a localisation that corrects itself and thinks better of it makes one.
_SWINGS: Final = 3
_WITHIN: Final = 2.0


class PoseSwings:
    """Follows the poses of one stream by their stamps, in whatever order they come; not thread-safe.

    Of two publishers one may stamp a little earlier than the other, as a filter does that stamps by what it measured
    last: its poses come late each time, and lie between those of the other.
    """

    def __init__(self, what: str) -> None:
        """Know no pose yet of what is so called, such as ``odometry``."""
        self._what = what
        self._stamps: list[float] = []
        self._poses: list[Pose] = []
        self._swings: deque[float] = deque(maxlen=_SWINGS)

    def forget(self) -> None:
        """Forget all poses, because the clock was set back or the localisation began anew."""
        self._stamps.clear()
        self._poses.clear()
        self._swings.clear()

    def take(self, stamp: float, pose: Pose) -> str:
        """Take in a pose, and say that it is part of one of several swings; empty when it is not.

        Args:
            stamp: seconds of the robot's clock; where that was set back, all before is forgotten.
            pose: in one frame with the others.
        """
        stamps, poses = self._stamps, self._poses
        if stamps and stamp < stamps[-1] - _WITHIN:
            self.forget()
        at = bisect_right(stamps, stamp)
        stamps.insert(at, stamp)
        poses.insert(at, pose)
        outdated = bisect_right(stamps, stamps[-1] - _WITHIN)
        del stamps[:outdated], poses[:outdated]
        at -= outdated
        # It may be the end, the middle or the beginning of the way there and back.
        ways = (poses[begin : begin + 3] for begin in range(max(at - 2, 0), at + 1))
        swing = next((way for way in ways if len(way) == 3 and _goes_back(*way)), None)
        if swing is None:
            return ""
        self._swings.append(stamp)
        if len(self._swings) < _SWINGS or max(self._swings) - min(self._swings) > _WITHIN:
            return ""
        metres, radians = _between(swing[1], swing[2])
        return (
            f"the pose swings between places {metres:.1f} m and {radians:.1f} rad apart: two nodes publish the "
            f"{self._what} and disagree, stop one"
        )


def _goes_back(first: Pose, second: Pose, third: Pose) -> bool:
    """Whether the way from the first pose over the second to the third ends near where it began."""
    there, back, left = _between(first, second), _between(second, third), _between(first, third)
    return any(min(a, b) > _LEAST and c < _BACK * min(a, b) for a, b, c in zip(there, back, left, strict=True))


def _between(one: Pose, other: Pose) -> tuple[float, float]:
    """Return the metres and the radians between two poses."""
    return one.distance_to(other.position), abs(remainder(one.yaw - other.yaw, 2.0 * pi))
