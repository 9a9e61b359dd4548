"""Poses that no motion of the robot explains: an odometry that began anew, a robot that was carried."""

from __future__ import annotations

from math import hypot, pi, remainder
from typing import Final

from common.geometry import Pose

# No localisation corrects a heading by so much at once, radians.
_TURN: Final = 0.5


def leap(before: Pose, after: Pose, elapsed: float, jump: float, speed: float) -> str:
    """Say how far the pose leapt from one message to the next; empty where the robot can have moved so.

    Args:
        before: pose of the earlier message.
        after: that of the later one, same frame.
        elapsed: seconds between their stamps.
        jump: metres that a localisation may correct at once.
        speed: fastest of the robot, m/s.
    """
    moved = hypot(after.x - before.x, after.y - before.y)
    return f"the pose jumped {moved:.2f} m in {elapsed:.2f} s" if moved > jump + speed * elapsed else ""


class PoseLeaps:
    """Follows the poses of one stream; not thread-safe.

    Usage::

        why = leaps.take(stamp, pose)
    """

    def __init__(self, *, jump: float, speed: float, turn_rate: float, timeout: float) -> None:
        """Know no pose yet.

        Args:
            jump: as for `leap`.
            speed: as for `leap`.
            turn_rate: fastest of the robot, rad/s.
            timeout: seconds without a pose after which the robot may be anywhere.
        """
        self._jump, self._speed, self._turn_rate = jump, speed, turn_rate
        self._timeout = timeout
        self._last: tuple[float, Pose] | None = None

    def take(self, stamp: float, pose: Pose) -> str:
        """Take in a pose, and say why it may not continue the one before; empty where it does.

        Args:
            stamp: seconds of the robot's clock; where that was set back, no time has passed.
            pose: same frame as those before.
        """
        last, self._last = self._last, (stamp, pose)
        if last is None:
            return ""
        elapsed = max(stamp - last[0], 0.0)
        if elapsed > self._timeout:
            return f"no pose came for {elapsed:.1f} s"
        turned = abs(remainder(pose.yaw - last[1].yaw, 2.0 * pi))
        if turned > _TURN + self._turn_rate * elapsed:
            return f"the pose turned {turned:.2f} rad in {elapsed:.2f} s"
        return leap(last[1], pose, elapsed, self._jump, self._speed)
