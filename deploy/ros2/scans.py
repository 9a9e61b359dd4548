"""LaserScan messages to ranges, and back."""

from __future__ import annotations

import math

import numpy as np

from common.geometry import Scan
from deploy.ros2.errors import RosError
from deploy.ros2.messages import Message, header, message

MAX_BEAMS = 1 << 17
"""Scans of more beams are refused."""
MAX_ANGLE = 4.0 * math.pi
"""Greater angles of a scan are refused, radians: they are degrees."""
LONGEST_SWEEP = 1.0
"""Lidars turn faster than this, seconds."""
NEAREST_LIMIT = 10.0
"""A scan with a greater range_min is refused, metres: it is in millimetres."""


def scan_from(scan: Message) -> Scan:
    """Return the ranges of a LaserScan, without a copy where they are float32 already.

    A range_max of infinity, which pointcloud_to_laserscan sends where no limit is set, is the largest float32.

    Raises:
        RosError: when the angles or ranges are not finite or not increasing limits, angles are in degrees, limits in
            millimetres, or there are too many beams.
    """
    range_max = min(scan.range_max, float(np.finfo(np.float32).max))
    numbers = (scan.angle_min, scan.angle_increment, scan.range_min, range_max)
    if not all(math.isfinite(number) for number in numbers) or scan.angle_increment == 0.0:
        raise RosError(f"a LaserScan needs finite angles and range limits and an increment, got {numbers}")
    if not 0.0 <= scan.range_min < range_max:
        raise RosError(f"a LaserScan's range_min {scan.range_min} must be below its range_max {scan.range_max}")
    if scan.range_min > NEAREST_LIMIT:
        raise RosError(
            f"a LaserScan's ranges must be metres, got range_min {scan.range_min:g} and range_max "
            f"{scan.range_max:g}: are they millimetres?"
        )
    if max(abs(scan.angle_min), abs(scan.angle_increment)) > MAX_ANGLE:
        raise RosError(
            f"a LaserScan's angles must be radians, got angle_min {scan.angle_min:g} and angle_increment "
            f"{scan.angle_increment:g}: are they degrees?"
        )
    if len(scan.ranges) > MAX_BEAMS:
        raise RosError(f"a LaserScan must have at most {MAX_BEAMS} beams, got {len(scan.ranges)}")
    ranges = np.asarray(scan.ranges, np.float32)
    return Scan(ranges, scan.angle_min, scan.angle_increment, range_max, scan.range_min)


def sweep_of(scan: Message) -> float:
    """Return the time from the first beam of a LaserScan to its last, seconds; 0 where all are of one moment.

    A time_increment that cannot be true is taken for none; see `scan_note`.
    """
    sweep = max(len(scan.ranges) - 1, 0) * float(scan.time_increment)
    return sweep if 0.0 < sweep <= LONGEST_SWEEP else 0.0


def scan_note(scan: Message) -> str:
    """Return what is strange about a LaserScan that can be used all the same, one line; empty when nothing is."""
    if not 0.0 <= max(len(scan.ranges) - 1, 0) * float(scan.time_increment) <= LONGEST_SWEEP:
        return (
            f"a LaserScan's time_increment must be the seconds between two beams, got {scan.time_increment:g} for "
            f"{len(scan.ranges)} beams: they count as sent at once, and walls smear while the robot turns; correct the "
            "driver"
        )
    if len(scan.intensities) not in {0, len(scan.ranges)}:
        return f"a LaserScan of {len(scan.ranges)} ranges has {len(scan.intensities)} intensities: correct the driver"
    return ""


def laser_scan(time: float, frame: str, scan: Scan, scan_time: float = 0.0) -> Message:
    """Build a LaserScan; angle_max is the last beam's angle.

    Args:
        time: stamp, seconds.
        frame: frame of the lidar.
        scan: ranges and angles.
        scan_time: seconds between scans.
    """
    return message(
        "sensor_msgs/msg/LaserScan",
        header=header(time, frame),
        angle_min=scan.angle_min,
        angle_max=scan.angle_min + max(len(scan.ranges) - 1, 0) * scan.angle_increment,
        angle_increment=scan.angle_increment,
        scan_time=scan_time,
        range_min=scan.range_min,
        range_max=scan.range_max,
        ranges=scan.ranges,
    )
