"""Whether poses swing between two places: two publishers of one odometry or transform disagree."""

from __future__ import annotations

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
    """Follows poses as they come; times are seconds of one clock, given by the caller. Not thread-safe."""

    def __init__(self) -> None:
        """Know no pose yet."""
        self._poses: deque[Pose] = deque(maxlen=2)
        self._times: deque[float] = deque(maxlen=_SWINGS)

    def take(self, now: float, pose: Pose) -> str:
        """Take in the newest pose, and say that it is one of several swings; empty when it is not."""
        earlier = tuple(self._poses)
        self._poses.append(pose)
        if len(earlier) < 2:
            return ""
        there, back, left = _between(*earlier), _between(earlier[1], pose), _between(earlier[0], pose)
        if not any(min(a, b) > _LEAST and c < _BACK * min(a, b) for a, b, c in zip(there, back, left, strict=True)):
            return ""
        self._times.append(now)
        if len(self._times) < _SWINGS or now - self._times[0] > _WITHIN:
            return ""
        metres, radians = back
        return (
            f"the pose swings between places {metres:.2f} m and {radians:.2f} rad apart: two nodes publish the "
            "odometry or the transform of the base and disagree, stop one"
        )


def _between(one: Pose, other: Pose) -> tuple[float, float]:
    """Return the metres and the radians between two poses."""
    return one.distance_to(other.position), abs(remainder(one.yaw - other.yaw, 2.0 * pi))
