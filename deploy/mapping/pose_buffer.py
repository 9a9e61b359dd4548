"""Poses by time: what the odometry said, interpolated to the moment of a scan."""

from __future__ import annotations

import logging
from bisect import bisect_left
from math import isfinite, pi, remainder

from common.geometry import Pose

logger = logging.getLogger(__name__)


class PoseBuffer:
    """The poses of the last seconds, in order of their stamps; not thread-safe.

    Messages may come out of order or twice. A stamp that lies further back than the whole buffer means that the robot's
    clock was set back (a simulation that began anew, a recording that is played in a loop): the buffer starts anew.
    """

    def __init__(self, seconds: float = 10.0, count: int = 4000) -> None:
        """Keep the poses of the last ``seconds``, at most ``count`` of them."""
        self._seconds = seconds
        self._count = count
        self._times: list[float] = []
        self._poses: list[tuple[Pose, float]] = []

    def __len__(self) -> int:
        return len(self._times)

    @property
    def newest(self) -> tuple[float, Pose, float] | None:
        """Stamp, pose and floor height of the newest pose, None while there is none."""
        return (self._times[-1], *self._poses[-1]) if self._times else None

    def add(self, time: float, pose: Pose, floor: float = 0.0) -> bool:
        """Add a pose; False when its numbers are not finite, and it is left out.

        Args:
            time: its stamp, seconds of the robot's clock.
            pose: of the base in the map frame.
            floor: height of the floor below the base in the map frame, metres.
        """
        if not all(isfinite(number) for number in (time, pose.x, pose.y, pose.yaw, floor)):
            return False
        times = self._times
        if times and time < times[-1] - self._seconds:
            logger.warning("poses jumped back from %.3f s to %.3f s: the clock was set back", times[-1], time)
            self.clear()
        at = bisect_left(times, time)
        if at < len(times) and times[at] == time:
            self._poses[at] = (pose, floor)
            return True
        times.insert(at, time)
        self._poses.insert(at, (pose, floor))
        outdated = max(bisect_left(times, times[-1] - self._seconds), len(times) - self._count)
        # Cutting off a tenth at a time keeps the cost of an insertion constant.
        if outdated > self._count // 10 or len(times) > self._count:
            del times[:outdated], self._poses[:outdated]
        return True

    def clear(self) -> None:
        """Forget all poses."""
        self._times.clear()
        self._poses.clear()

    def at(self, time: float, tolerance: float) -> tuple[Pose, float] | None:
        """Return pose and floor height at a time, or None when the buffer does not tell.

        Between two poses the position is interpolated in a straight line and the yaw along the shorter arc. Beyond the
        ends, and in a gap of the poses, the nearest pose counts where it is within the tolerance.

        Args:
            time: seconds of the robot's clock.
            tolerance: how far the nearest pose may lie off, seconds.
        """
        times = self._times
        at = bisect_left(times, time)
        if at < len(times) and times[at] == time:
            return self._poses[at]
        before = time - times[at - 1] if at > 0 else float("inf")
        after = times[at] - time if at < len(times) else float("inf")
        if min(before, after) > tolerance:
            return None
        if before + after > 2.0 * tolerance:
            return self._poses[at - 1 if before <= after else at]
        (old, old_floor), (new, new_floor) = self._poses[at - 1], self._poses[at]
        share = before / (before + after)
        turn = remainder(new.yaw - old.yaw, 2.0 * pi)
        pose = Pose(
            old.x + share * (new.x - old.x),
            old.y + share * (new.y - old.y),
            remainder(old.yaw + share * turn, 2.0 * pi),
        )
        return pose, old_floor + share * (new_floor - old_floor)
