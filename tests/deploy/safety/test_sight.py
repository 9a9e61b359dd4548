"""What a scan must show to count as sight."""

import math

import numpy as np
import pytest

from common.geometry import Pose, Scan
from deploy.config import SafetyConfig
from deploy.ros2.conversions import laser_scan, point_cloud, points_from
from deploy.safety.faults import FaultKind
from deploy.safety.sight import Sight

HERE = Pose(0.0, 0.0)
STEP = 2 * math.pi / 720


def sight() -> Sight:
    return Sight(SafetyConfig(), 0.3)


def look(eye: Sight, ranges, pose=HERE, now=0.0, *, step=STEP, top=None):
    scan = Scan(np.asarray(ranges, np.float32), -math.pi, step, 30.0, 0.1)
    message = laser_scan(now, "laser", scan)
    if top is not None:
        message.angle_max = top
    fault = eye.scan(message, scan, pose, now)
    return None if fault is None else fault.kind


def noise(seed=0, beams=720):
    return np.random.default_rng(seed).uniform(1.0, 20.0, beams).astype(np.float32)


def test_what_lidars_really_send_is_sound():
    eye = sight()
    assert look(eye, noise()) is None
    assert look(eye, np.full(720, np.inf)) is None, "nothing is in range"
    assert look(eye, np.where(np.arange(720) < 180, noise(), np.nan)) is None, "the body hides three quarters"
    assert look(eye, noise(), top=-math.pi + 720 * STEP) is None, "angle_max one beam too far"
    assert look(eye, noise(beams=719)) is None


@pytest.mark.parametrize("value", [np.nan, 0.0, 0.05, -np.inf], ids=str)
def test_a_scan_that_tells_nothing_is_blind(value):
    assert look(sight(), np.full(720, value)) is FaultKind.SENSOR_BLIND


def test_too_few_beams_are_blind_whether_the_others_are_spoilt_or_missing():
    assert look(sight(), np.where(np.arange(720) < 10, 5.0, np.nan)) is FaultKind.SENSOR_BLIND
    eye = sight()
    assert look(eye, noise()) is None
    assert look(eye, noise(beams=10)) is FaultKind.SENSOR_BLIND
    assert look(sight(), []) is not None


@pytest.mark.parametrize(
    ("beams", "step", "top"),
    [(720, 2 * math.pi / 700, math.pi), (10, STEP, math.pi), (720, STEP, 180.0), (720, 0.5, None), (720, STEP, 0.0)],
)
def test_angles_that_do_not_fit_the_number_of_beams_are_invalid(beams, step, top):
    assert look(sight(), noise(beams=beams), step=step, top=top) is FaultKind.SENSOR_INVALID


def test_readings_that_stay_the_same_while_the_robot_moves_are_frozen():
    eye = sight()
    found = [look(eye, noise(), Pose(0.05 * k, 0.0), 0.1 * k) for k in range(8)]
    assert found == [None] * 5 + [FaultKind.SENSOR_FROZEN] * 3
    assert look(eye, noise(1), Pose(0.4, 0.0), 0.8) is None
    turning = [look(eye, noise(1), Pose(0.4, 0.0, 0.1 * k), 0.9 + 0.1 * k) for k in range(5)]
    assert turning[-1] is FaultKind.SENSOR_FROZEN


def test_a_corrected_pose_is_no_motion_of_a_robot_that_stands():
    eye = sight()
    assert look(eye, noise()) is None
    assert look(eye, noise(), Pose(3.0, 0.0), 0.1) is None, "relocalised somewhere else"
    assert look(eye, noise(), Pose(3.2, 0.0, 3.1), 0.2) is None, "relocalised the other way round"
    assert look(eye, noise(), Pose(3.2, 0.0, -2.9), 0.6) is FaultKind.SENSOR_FROZEN, "turned"


def test_the_same_readings_are_right_for_a_robot_that_stands_or_sees_nothing():
    eye = sight()
    assert all(look(eye, noise(), Pose(0.01 * (k % 3), 0.0), 0.1 * k) is None for k in range(100))
    assert look(eye, noise(), Pose(4.0, 0.0), 10.0) is None, "its localisation corrected itself"
    eye = sight()
    assert all(look(eye, np.full(720, np.inf), Pose(0.1 * k, 0.0), 0.1 * k) is None for k in range(100))


def test_clouds():
    eye = sight()
    points = np.random.default_rng(0).uniform(-9.0, 9.0, (500, 3)).astype(np.float32)

    def kind(points, x=0.0, now=0.0):
        message = point_cloud(now, "map", points.astype(np.float32))
        fault = eye.points(message, points_from(message), Pose(x, 0.0), now)
        return None if fault is None else fault.kind

    assert kind(points) is None
    assert kind(np.full((500, 3), np.nan)) is FaultKind.SENSOR_BLIND
    assert kind(np.zeros((500, 3))) is FaultKind.SENSOR_BLIND
    assert kind(points[:10]) is FaultKind.SENSOR_BLIND
    found = [kind(points, 0.1 * k, 0.1 * k) for k in range(5)]
    assert found == [None] * 3 + [FaultKind.SENSOR_FROZEN] * 2


def scan_of(ranges, range_max):
    scan = Scan(np.asarray(ranges, np.float32), -math.pi, STEP, range_max, 0.1)
    return sight().scan(laser_scan(0.0, "laser", scan), scan, HERE, 0.0)


@pytest.mark.parametrize("range_max", [30.0, 30_000.0, 3e38])
def test_ranges_in_millimetres_are_invalid_and_not_a_free_world(range_max):
    fault = scan_of(noise() * 1000.0, range_max)
    assert fault is not None and fault.kind is FaultKind.SENSOR_INVALID and "millimetres" in fault.reason
    mostly = np.where(np.arange(720) % 3 == 0, 0.0, noise() * 1000.0)
    assert scan_of(mostly, range_max) is not None, "zero where nothing is met"


def test_numbers_beyond_range_max_may_stand_for_nothing_met():
    assert scan_of(np.full(720, 65.533), 6.0) is None
    assert scan_of(np.where(np.arange(720) % 2 == 0, 6.5, 7.0), 6.0) is None
    assert scan_of(noise() + 6.0, 6.0) is None, "the driver limits the range, the lidar sees further"
    assert scan_of(noise() + 40.0, 200.0) is None, "a wide field"
