"""Lidars that have a number of their own for nothing met."""

from functools import cache
from math import pi

import numpy as np
import pytest

from common.geometry import Pose, Scan
from deploy.mapping.log_odds import Beams
from deploy.ros2 import conversions as ros
from deploy.ros2.no_return import understood
from deploy.safety.health import FaultKind
from tests.deploy.mapping.lidar import scan_at
from tests.deploy.mapping.test_frames import Robot

HALL = np.zeros((200, 200), dtype=np.bool_)
HALL[2:-2, 2:-2] = True
"""Of 50 m, in cells of 0.25 m."""


def driven(number: float, *overrides: str, x: float = 25.0) -> Robot:
    """A robot that has driven 2 m in the hall with a lidar of 12 m that says a number where it meets nothing."""
    robot = Robot("mapping.resolution=0.25", *overrides)
    for step in range(40):
        robot.time = 1.0 + 0.1 * step
        base = Pose(x + 0.05 * step, 25.0, 0.02 * step)
        robot.take("odometry", ros.odometry(robot.time, "map", "base_link", base))
        scan = scan_at(HALL, base)
        ranges = np.where(scan.ranges < (number if 1.0 < number < 12.0 else 12.0), scan.ranges, np.float32(number))
        sent = Scan(ranges.astype(np.float32), scan.angle_min, scan.angle_increment, 12.0, 0.1)
        robot.take("scan", ros.laser_scan(robot.time, "base_link", sent))
    return robot


def cells(robot: Robot) -> tuple[int, int]:
    """Occupied and free cells."""
    states = robot.map.occupancy()[0]
    return int((states == 100).sum()), int((states == 0).sum())


@cache
def expected(x: float) -> tuple[int, int]:
    return cells(driven(np.inf, x=x))


@pytest.mark.parametrize(
    ("number", "overrides"),
    [
        (12.0, ()),
        (11.99, ()),
        (11.7, ()),
        (65.533, ()),
        (0.0, ("sensing.no_return=0",)),
        (-1.0, ("sensing.no_return=-1",)),
        (np.nan, ("sensing.no_return=nan",)),
    ],
)
@pytest.mark.parametrize("x", [25.0, 5.0], ids=["open", "beside a wall"])
def test_open_space_is_free_whatever_number_says_so(number, overrides, x):
    robot, (occupied, free) = driven(number, *overrides, x=x), expected(x)
    # Beyond what such a lidar can tell no wall is seen, either.
    assert 0.9 * occupied <= cells(robot)[0] <= occupied
    assert cells(robot)[1] == pytest.approx(free, rel=0.06)
    assert not any(robot.told) and robot.map.statistics.dropped == {}


def test_where_the_number_is_below_range_max_the_lidar_sees_no_farther():
    robot = driven(8.0, "sensing.no_return=8", x=5.0)
    assert cells(robot) == cells(driven(np.inf, "sensing.range_max=8", x=5.0))
    assert not any(robot.told)


@pytest.mark.parametrize(("number", "setting"), [(0.0, "no_return=0"), (-1.0, "no_return=-1"), (8.0, "no_return=8")])
def test_a_number_that_may_mean_nothing_met_is_named_once_with_the_setting(number, setting):
    robot = driven(number, x=5.0)
    notes = {told for told in robot.told if told}
    assert len(notes) == 1 and setting in notes.pop()


@pytest.mark.parametrize(("number", "setting"), [(0.0, "no_return=0"), (8.0, "no_return=8"), (np.nan, "no_return=nan")])
def test_the_fault_that_stops_the_robot_names_the_setting(number, setting):
    robot = driven(number)
    faults = robot.inputs._health.check(robot.time)
    assert faults[0].kind in {FaultKind.SENSOR_BLIND, FaultKind.SENSOR_FROZEN}
    assert f"sensing.{setting}" in faults[0].reason


def test_a_wall_near_the_limit_stays_a_wall():
    """Its beams differ: a planar wall has no two of one length but by chance."""
    angles = np.linspace(-0.5, 0.5, 200)
    ranges = np.round(11.7 / np.cos(angles), 3).astype(np.float32)
    scan, note = understood(Scan(ranges, -0.5, 1.0 / 199, 12.0, 0.1), None)
    assert note == "" and scan.range_max == 12.0
    assert Beams.from_scan(scan, 0.3, 20.0).hits[100]


def test_parts_of_the_robot_that_are_seen_alike_are_not_taken_for_nothing_met():
    scan = scan_at(HALL, Pose(5.0, 25.0))
    ranges = scan.ranges.copy()
    ranges[:120] = 0.42
    seen, note = understood(Scan(ranges, scan.angle_min, scan.angle_increment, 12.0, 0.1), None)
    assert note == "" and seen.range_max == 12.0


def test_beams_without_a_return_are_free_up_to_the_sensors_limit_and_no_farther():
    scan, _ = understood(Scan(np.full(720, 11.9, np.float32), -pi, pi / 360, 12.0, 0.1), None)
    beams = Beams.from_scan(scan, 0.3, 20.0)
    assert not beams.hits.any() and beams.ranges == pytest.approx(11.9)
