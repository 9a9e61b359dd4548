"""Scans that contradict the map which earlier ones made are named."""

from math import sin

import numpy as np
import pytest

from common.geometry import Pose, Scan
from deploy.ros2 import conversions as ros
from tests.deploy.mapping.lidar import scan_at
from tests.deploy.mapping.test_frames import FREE, Robot


def along(time: float) -> Pose:
    """Of a robot that drives about in the room and turns both ways."""
    return Pose(4.5 + 1.5 * sin(0.3 * time), 5.0 + 1.5 * sin(0.23 * time), 1.2 * sin(0.8 * time))


def driven(spoil=lambda scan, rng: scan, *, lag: float = 0.0) -> list[str]:
    """What was told of 20 s of scans at 10 Hz, each seen some seconds before its stamp."""
    robot, rng = Robot("mapping.resolution=0.1"), np.random.default_rng(3)
    for step in range(200):
        robot.time = 2.0 + 0.1 * step
        robot.take("odometry", ros.odometry(robot.time, "map", "base_link", along(robot.time)))
        seen = spoil(scan_at(FREE, along(robot.time - lag), noise=0.02, rng=rng, beams=360), rng)
        robot.take("scan", ros.laser_scan(robot.time, "base_link", seen))
    return [told for told in robot.told if told]


def mirrored(scan: Scan, rng: np.random.Generator) -> Scan:
    del rng
    return Scan(scan.ranges[::-1].copy(), scan.angle_min, scan.angle_increment, scan.range_max, scan.range_min)


def among_people(scan: Scan, rng: np.random.Generator) -> Scan:
    """Six people who stand somewhere else in each scan, and hide a third of the room."""
    ranges = scan.ranges.copy()
    for _ in range(6):
        first = int(rng.integers(0, len(ranges) - 20))
        ranges[first : first + 20] = np.minimum(ranges[first : first + 20], rng.uniform(1.0, 4.0))
    return Scan(ranges, scan.angle_min, scan.angle_increment, scan.range_max, scan.range_min)


@pytest.mark.parametrize(("spoil", "lag"), [(mirrored, 0.0), (lambda scan, rng: scan, 1.0)], ids=["mirrored", "late"])
def test_a_lidar_that_is_mirrored_or_late_is_named(spoil, lag):
    assert any("upside down" in told and "same clock" in told for told in driven(spoil, lag=lag))


@pytest.mark.parametrize("spoil", [lambda scan, rng: scan, among_people], ids=["empty", "people"])
def test_scans_that_agree_are_not(spoil):
    assert driven(spoil) == []
