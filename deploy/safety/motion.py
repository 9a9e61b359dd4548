"""Whether the pose shows the motion that the robot was told to make, or that its wheels report."""

from __future__ import annotations

import threading
from math import cos, hypot, pi, remainder, sin
from typing import Final

from common.geometry import Pose

# A pose that shows less than the second pair while the first pair was to be expected stands still: metres, radians.
_EXPECTED: Final = (0.3, 0.5)
_SHOWN: Final = (0.05, 0.1)
_COMMANDED: Final = "the robot was commanded to move"
_WHEELS: Final = "its wheels turn"
_REMEDY: Final = {
    _COMMANDED: "are its motors on, does its base hear the velocities (`hd-deploy topics`), is it stuck?",
    _WHEELS: "restart the localisation, or is the robot stuck?",
}
# Slower than this is rest: m/s, rad/s.
_REST: Final = (0.02, 0.05)
# A velocity counts no longer than this without another one, seconds.
_LASTS: Final = 0.5
# The wheels, the localisation and the wire may be so late with the first motion, seconds and poses.
_PATIENCE: Final = 0.3
_POSES: Final = 3
# A robot that may only have been stuck tries again after this many seconds, and after twice as many every further time.
_RETRY: Final = 30.0
_LONGEST_RETRY: Final = 480.0


class _DeadReckoning:
    """Where a robot would be by the velocities that were told."""

    def __init__(self) -> None:
        self._velocity = (0.0, 0.0)
        self._told = self._now = 0.0
        self.begin(0.0)

    def begin(self, now: float) -> None:
        self.x = self.y = self.yaw = 0.0
        self._now = now

    def tell(self, now: float, linear: float, angular: float) -> None:
        self.advance(now)
        self._velocity, self._told = (linear, angular), now

    def advance(self, now: float) -> None:
        seconds = min(now, self._told + _LASTS) - self._now
        if seconds > 0.0:
            linear, angular = self._velocity
            self.x += linear * seconds * cos(self.yaw)
            self.y += linear * seconds * sin(self.yaw)
            self.yaw += angular * seconds
        self._now = max(self._now, now)

    def rests(self, now: float) -> bool:
        linear, angular = self._velocity
        return now - self._told > _LASTS or (abs(linear) < _REST[0] and abs(angular) < _REST[1])

    def expected(self, pace: float) -> tuple[float, float]:
        """Return how far and how much the robot has moved, where its time passes so many times as fast as ours."""
        return pace * hypot(self.x, self.y), pace * abs(self.yaw)


class MotionWatch:
    """Compares the pose with the velocities that were sent to the wheels, and with those that the wheels report.

    A pose that stood still is over when it moves, by a command, or for another try after a while: a robot that was
    merely stuck must not stand for ever. All times are seconds of one monotonic clock; every method is thread-safe.
    """

    def __init__(self) -> None:
        """Know neither pose nor velocity."""
        self._lock = threading.Lock()
        self._sources = {_COMMANDED: _DeadReckoning(), _WHEELS: _DeadReckoning()}
        self._commanded, self._measured = self._sources.values()
        self._anchor: tuple[float, float, Pose] | None = None
        self._poses = 0
        self._fault: tuple[float, str] | None = None
        self._retry = _RETRY

    def commanded(self, now: float, linear: float, angular: float) -> None:
        """Hear of a velocity that was let through to the wheels, m/s and rad/s."""
        with self._lock:
            self._commanded.tell(now, linear, angular)

    def measured(self, now: float, linear: float, angular: float) -> None:
        """Hear of a velocity that the odometry reports, m/s and rad/s."""
        with self._lock:
            self._measured.tell(now, linear, angular)

    def heard_pose(self, now: float, stamp: float, pose: Pose) -> None:
        """Hear of a new pose.

        Args:
            now: time of arrival.
            stamp: of the pose, on the robot's clock, which passes slower than ours where a simulation does.
            pose: in the map frame.
        """
        with self._lock:
            for source in self._sources.values():
                source.advance(now)
            if self._anchor is None:
                self._begin(now, stamp, pose)
                return
            since, stamped, anchor = self._anchor
            shown = pose.distance_to(anchor.position), abs(remainder(pose.yaw - anchor.yaw, 2.0 * pi))
            if shown[0] >= _SHOWN[0] or shown[1] >= _SHOWN[1]:
                self._begin(now, stamp, pose)
                self._fault, self._retry = None, _RETRY
                return
            if self._fault is not None:
                return
            if all(source.rests(now) for source in self._sources.values()):
                self._begin(now, stamp, pose)
                return
            self._poses += 1
            if now - since < _PATIENCE or self._poses < _POSES:
                return
            pace = min(max((stamp - stamped) / (now - since), 0.0), 1.0)
            for what, source in self._sources.items():
                way, turn = source.expected(pace)
                if way >= _EXPECTED[0] or turn >= _EXPECTED[1]:
                    reason = (
                        f"the pose does not change while {what}: expected {way:.2f} m and {turn:.2f} rad, got "
                        f"{shown[0]:.2f} m and {shown[1]:.2f} rad; {_REMEDY[what]}"
                    )
                    self._fault = now, reason
                    return

    def forgive(self) -> None:
        """Forget a pose that stood still, because an operator wants the robot to try again."""
        with self._lock:
            self._fault, self._anchor, self._retry = None, None, _RETRY

    def fault(self, now: float) -> str:
        """Say that the pose stands still though the robot should move; empty while it does not."""
        with self._lock:
            if self._fault is None:
                return ""
            began, reason = self._fault
            if now - began < self._retry:
                return reason
            self._fault, self._anchor = None, None
            self._retry = min(2.0 * self._retry, _LONGEST_RETRY)
            return ""

    def _begin(self, now: float, stamp: float, pose: Pose) -> None:
        self._anchor = now, stamp, pose
        self._poses = 0
        for source in self._sources.values():
            source.begin(now)
