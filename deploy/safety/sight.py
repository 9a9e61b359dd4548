"""Whether a scan or a cloud shows the robot anything: arrival alone is no sight."""

from __future__ import annotations

import math
from math import hypot, pi, remainder
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose, Scan
from common.mapping.belief import RANGE_TOLERANCE
from deploy.config import SafetyConfig
from deploy.ros2 import Message
from deploy.ros2.no_return import common_invalid, setting
from deploy.safety.faults import Fault, FaultKind

# Drivers count the last beam in or leave it out, and round: so many increments, or this share of the angle, may be off.
_ODD_BEAMS: Final = 2.0
_ODD_SHARE: Final = 0.01
# A sensor whose readings stay the same to the last bit over so much way (metres) or turn (radians) is frozen.
_SAME_WAY: Final = 0.25
_SAME_TURN: Final = 0.25
# A step of the pose that is this much longer than the speed limit allows is a correction, and no way; metres.
_CORRECTION: Final = 0.05
# Nor does a robot on wheels turn faster than this, rad/s; a step of the heading may be off by as many radians.
_FASTEST_TURN: Final = 2.0 * pi
_CORRECTED_TURN: Final = 0.1
_FEWEST_POINTS: Final = 30
# Ranges are not in metres where those of most beams differ, and twentieth and median lie so far out: both as multiples
# of the scan's own range_max, or both in metres. Markers of drivers for nothing met are few different numbers.
_FEWEST_NUMBERS: Final = 8
_TIMES_RANGE_MAX: Final = (1.0, 10.0)
_METRES: Final = (50.0, 100.0)


class Sight:
    """Looks at every message of the sensor that the map is made from; not thread-safe.

    Usage::

        fault = sight.scan(message, scan_from(message), pose, now)
    """

    def __init__(self, config: SafetyConfig, range_min: float) -> None:
        """Have seen nothing yet; readings nearer than ``range_min`` metres are the robot itself."""
        self._config = config
        self._range_min = range_min
        self._beams = 0
        self._last: NDArray[Any] | None = None
        self._anchor: Pose | None = None
        self._before: tuple[float, Pose] | None = None

    def scan(self, message: Message, scan: Scan, pose: Pose | None, now: float) -> Fault | None:
        """Say what is wrong with a scan; None when it is sound.

        Args:
            message: the sensor_msgs/LaserScan.
            scan: what was read from it.
            pose: of the robot, map frame; None while it is not known.
            now: time of arrival, seconds.
        """
        # Beams that met nothing read the same wherever the robot is, whatever number says so.
        met = scan.ranges[(scan.ranges >= scan.range_min) & (scan.ranges < scan.range_max - RANGE_TOLERANCE)]
        fault = (
            _angle_fault(message, scan)
            or _unit_fault(scan)
            or self._blind(scan)
            or self._frozen(scan.ranges, len(met) > 0, pose, now)
        )
        if fault is not None and fault.kind is FaultKind.SENSOR_FROZEN and (met == met[0]).all():
            remedy = f"where it reads {met[0]:g} m when it meets nothing, set {setting(float(met[0]))}"
            return Fault(fault.kind, f"{fault.reason}: {remedy}")
        return fault

    def points(self, message: Message, points: NDArray[np.float32], pose: Pose | None, now: float) -> Fault | None:
        """Say what is wrong with a cloud; None when it is sound.

        Args:
            message: the sensor_msgs/PointCloud2.
            points: its finite points, shape (n, 3 or more).
            pose: as for `scan`.
            now: likewise.
        """
        count = int(message.height * message.width)
        if len(points) < max(_FEWEST_POINTS, self._config.min_beams * count):
            return Fault(FaultKind.SENSOR_BLIND, f"{len(points)} of {count} points of the cloud are usable")
        if (points == points[0]).all():
            return Fault(FaultKind.SENSOR_BLIND, f"all {len(points)} points of the cloud are one")
        return self._frozen(points, True, pose, now)

    def _blind(self, scan: Scan) -> Fault | None:
        # A scan that has shrunk is measured by the beams that it used to have.
        count = len(scan.ranges)
        self._beams = max(self._beams, count)
        # Infinite means that nothing was met, which is something; NaN and minus infinity tell nothing.
        told = int(np.count_nonzero(scan.ranges >= max(scan.range_min, self._range_min)))
        if told >= max(1.0, self._config.min_beams * self._beams):
            return None
        common, remedy = common_invalid(scan), ""
        if common is not None and 2 * common[1] > count:
            remedy = f"; where the lidar reads {common[0]:g} when it meets nothing, set {setting(common[0])}"
        elif 2 * np.count_nonzero(np.isnan(scan.ranges)) > count:
            remedy = f"; where the lidar reads NaN when it meets nothing, set {setting(math.nan)}"
        return Fault(
            FaultKind.SENSOR_BLIND,
            f"{told} of {self._beams} beams of the scan are usable, safety.min_beams requires "
            f"{self._config.min_beams:.0%}: the others are NaN, missing, or nearer than "
            f"{max(scan.range_min, self._range_min):g} m{remedy}",
        )

    def _frozen(self, data: NDArray[Any], returns: bool, pose: Pose | None, now: float) -> Fault | None:
        same = (
            self._last is not None
            and self._last.shape == data.shape
            and np.array_equal(self._last, data, equal_nan=True)
        )
        before, self._before = self._before, None if pose is None else (now, pose)
        if pose is None or not same or self._anchor is None or before is None:
            if not same:
                self._last = data.copy()
            self._anchor = pose
            return None
        seconds = now - before[0]
        step_x, step_y = pose.x - before[1].x, pose.y - before[1].y
        step_yaw = abs(remainder(pose.yaw - before[1].yaw, 2.0 * pi))
        if (
            hypot(step_x, step_y) > self._config.speed_limit * seconds + _CORRECTION
            or step_yaw > _FASTEST_TURN * seconds + _CORRECTED_TURN
        ):
            # The localisation corrected itself: the robot did not drive there.
            self._anchor = Pose(self._anchor.x + step_x, self._anchor.y + step_y, pose.yaw)
        way = pose.distance_to(self._anchor.position)
        turn = abs(remainder(pose.yaw - self._anchor.yaw, 2.0 * pi))
        # Where nothing is in range, every scan is the same.
        if not returns or (way < _SAME_WAY and turn < _SAME_TURN):
            return None
        return Fault(
            FaultKind.SENSOR_FROZEN,
            f"the sensor shows the same to the last bit, although the robot moved {way:.2f} m and turned "
            f"{turn:.2f} rad",
        )


def _angle_fault(message: Message, scan: Scan) -> Fault | None:
    """Compare the angles of a scan with the number of its beams."""
    count, step = len(scan.ranges), scan.angle_increment
    told, spanned = message.angle_max - scan.angle_min, (count - 1) * step
    wrong = abs(told - spanned)
    if count and wrong <= max(_ODD_BEAMS * abs(step), _ODD_SHARE * abs(told)) and abs(spanned) <= 2.0 * pi * 1.01:
        return None
    return Fault(
        FaultKind.SENSOR_INVALID,
        f"the angles of the scan contradict each other: {count} beams of {step:.6g} rad span {spanned:.4g} rad, but "
        f"angle_min and angle_max are {told:.4g} rad apart (at most 2 pi; radians, not degrees)",
    )


def _unit_fault(scan: Scan) -> Fault | None:
    """Look whether the ranges can be metres: millimetres are all beyond what counts, and the room would be free."""
    told = scan.ranges[np.isfinite(scan.ranges) & (scan.ranges > 0.0)]
    if 2 * len(told) <= len(scan.ranges):
        return None
    near, median = (float(number) for number in np.quantile(told, (0.05, 0.5)))
    limits = tuple(times * scan.range_max for times in _TIMES_RANGE_MAX)
    far = any(near > least and median > middle for least, middle in (limits, _METRES))
    if not far or len(np.unique(told)) < _FEWEST_NUMBERS:
        return None
    return Fault(
        FaultKind.SENSOR_INVALID,
        f"the ranges of the scan must be metres: {len(told)} of {len(scan.ranges)} beams have a median of {median:g}, "
        f"its range_max is {scan.range_max:g}: are they millimetres?",
    )
