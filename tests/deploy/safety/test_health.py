import math

import pytest

from common.geometry import Pose
from deploy.config import SafetyConfig
from deploy.safety.health import Fault, FaultKind, HealthMonitor

FENCE = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0))


def healthy(now: float = 10.0, **config) -> HealthMonitor:
    monitor = HealthMonitor(SafetyConfig(**config))
    monitor.heard_sensor(now)
    monitor.updated_map(now)
    monitor.heard_pose(now, 100.0, Pose(1.0, 1.0))
    return monitor


def kinds(monitor: HealthMonitor, now: float = 10.0, **arguments) -> set[FaultKind]:
    return {fault.kind for fault in monitor.check(now, **arguments)}


def test_a_map_that_comes_once_is_enough_while_poses_are_fresh():
    monitor = HealthMonitor(SafetyConfig(), sensor="grid")
    assert FaultKind.SENSOR_STALE in kinds(monitor, 1.0)
    monitor.heard_sensor(1.0)
    monitor.updated_map(1.0)
    monitor.heard_pose(500.0, 100.0, Pose(1.0, 1.0))
    assert kinds(monitor, 500.0) == set()
    assert kinds(monitor, 502.0) == {FaultKind.POSE_STALE}


def test_all_is_well():
    assert kinds(healthy()) == set()


def test_nothing_heard_yet():
    faults = HealthMonitor(SafetyConfig(), sensor="points").check(0.0)
    assert {fault.kind for fault in faults} == {FaultKind.SENSOR_STALE, FaultKind.POSE_STALE, FaultKind.MAP_STALE}
    assert faults[0].reason == "no points received yet"


@pytest.mark.parametrize(
    ("method", "kind"), [("heard_sensor", FaultKind.SENSOR_STALE), ("updated_map", FaultKind.MAP_STALE)]
)
def test_stale_inputs(method, kind):
    monitor = healthy(scan_timeout=1.0, pose_timeout=5.0)
    other = {"heard_sensor": monitor.updated_map, "updated_map": monitor.heard_sensor}[method]
    other(11.5)
    assert kinds(monitor, 11.5) == {kind}
    getattr(monitor, method)(11.5)
    assert kinds(monitor, 11.5) == set()


def test_stale_pose():
    monitor = healthy(scan_timeout=5.0, pose_timeout=1.0)
    assert kinds(monitor, 10.9) == set()
    assert kinds(monitor, 11.1) == {FaultKind.POSE_STALE}


def test_pose_may_move_as_fast_as_the_robot():
    monitor = healthy(speed_limit=2.0, pose_jump=1.0)
    monitor.heard_pose(10.1, 101.0, Pose(3.9, 1.0))
    assert kinds(monitor, 10.1) == set()


def test_pose_jump_stops_until_poses_are_steady():
    monitor = healthy(speed_limit=2.0, pose_jump=1.0, pose_timeout=1.0, scan_timeout=60.0)
    monitor.heard_pose(10.1, 100.1, Pose(2.3, 1.0))
    assert kinds(monitor, 10.1) == {FaultKind.POSE_JUMP}
    for tick in range(1, 12):
        monitor.heard_pose(10.1 + 0.1 * tick, 100.1 + 0.1 * tick, Pose(2.3, 1.0))
    assert kinds(monitor, 11.2) == set()


@pytest.mark.parametrize("back", [0.2, 0.5, 2.0, 10.0, 95.0])
@pytest.mark.parametrize("rate", [10.0, 30.0])
def test_clock_set_back_holds_and_then_begins_anew(back, rate):
    monitor, now = healthy(scan_timeout=60.0), 10.0
    found = []
    for tick in range(1, int(2.0 * rate)):
        now = 10.0 + tick / rate
        monitor.heard_pose(now, 100.0 + tick / rate - back, Pose(1.0 + 0.5 * tick / rate, 1.0))
        found.append(kinds(monitor, now))
    assert {FaultKind.CLOCK_SET_BACK} in found[:2], "within two poses"
    assert found[-1] == set()
    assert set().union(*found) == {FaultKind.CLOCK_SET_BACK}


def test_a_clock_set_back_does_not_hide_a_jump():
    monitor = healthy()
    monitor.heard_pose(10.1, 95.0, Pose(9.0, 1.0))
    assert FaultKind.POSE_JUMP in kinds(monitor, 10.1)


def test_one_pose_that_comes_late_is_no_fault():
    monitor = healthy()
    for now, stamp in ((10.1, 100.1), (10.2, 100.2), (10.2, 100.05), (10.3, 100.3), (10.4, 100.4), (10.4, 100.2)):
        monitor.heard_pose(now, stamp, Pose(1.0, 1.0))
        assert kinds(monitor, now) == set()


@pytest.mark.parametrize("part", ["sensor", "pose"])
def test_messages_whose_stamp_stands_still_are_no_news(part):
    monitor = healthy(scan_timeout=1.0, pose_timeout=1.0)
    monitor.heard_sensor(10.0, 100.0)
    for tick in range(1, 12):
        now, stamp = 10.0 + 0.1 * tick, 100.0 + 0.1 * tick
        monitor.updated_map(now)
        monitor.heard_sensor(now, 100.0 if part == "sensor" else stamp)
        monitor.heard_pose(now, 100.0 if part == "pose" else stamp, Pose(1.0, 1.0))
    (fault,) = monitor.check(11.15)
    assert fault.kind is (FaultKind.SENSOR_FROZEN if part == "sensor" else FaultKind.POSE_FROZEN)
    assert "stamp has not advanced beyond 100.0 s for 1 s" in fault.reason
    monitor.heard_sensor(11.2, 101.2)
    monitor.heard_pose(11.2, 101.2, Pose(1.0, 1.0))
    assert kinds(monitor, 11.2) == set()


def test_three_unsound_messages_in_a_row_are_a_fault_and_a_sound_one_ends_it():
    monitor = healthy()
    blind = Fault(FaultKind.SENSOR_BLIND, "0 of 720 beams tell anything")
    for tick, expected in ((1, []), (2, []), (3, [blind]), (4, [blind])):
        monitor.heard_sensor(10.0 + 0.1 * tick, 100.0 + 0.1 * tick, blind)
        assert monitor.check(10.0 + 0.1 * tick) == expected
    monitor.heard_sensor(10.5, 100.5)
    assert kinds(monitor, 10.5) == set()


def test_one_unsound_message_that_nothing_follows_in_time_is_a_fault():
    monitor = healthy(scan_timeout=1.0)
    blind = Fault(FaultKind.SENSOR_BLIND, "0 of 720 beams tell anything")
    for now in (10.8, 11.6):
        monitor.heard_sensor(now, now, blind)
    assert FaultKind.SENSOR_BLIND in kinds(monitor, 11.6)


def test_pose_that_is_not_finite():
    monitor = healthy()
    monitor.heard_pose(10.1, 100.1, Pose(math.nan, 1.0))
    assert kinds(monitor, 10.1) == {FaultKind.POSE_JUMP}


def test_policy_error_lasts_until_a_decision():
    monitor = healthy()
    monitor.policy_failed(ValueError("no weights"))
    (fault,) = monitor.check(10.0)
    assert fault.kind is FaultKind.POLICY_ERROR
    assert "ValueError: no weights" in fault.reason
    monitor.policy_decided()
    assert kinds(monitor) == set()


def test_waypoint_must_stay_free():
    monitor = healthy()
    assert kinds(monitor, waypoint=(2.0, 2.0), is_free=lambda place: True) == set()
    assert kinds(monitor, waypoint=(2.0, 2.0), is_free=lambda place: False) == {FaultKind.WAYPOINT_OCCUPIED}


def test_fence_holds_robot_and_waypoint():
    monitor = healthy(geofence=FENCE)
    assert kinds(monitor, waypoint=(2.0, 2.0)) == set()
    assert kinds(monitor, waypoint=(12.0, 2.0)) == {FaultKind.GEOFENCE}
    monitor.heard_pose(11.0, 106.0, Pose(10.5, 1.0))
    assert FaultKind.GEOFENCE in kinds(monitor, 10.0)


def test_reset_forgets():
    monitor = healthy()
    monitor.policy_failed(ValueError())
    monitor.reset()
    monitor.heard_pose(10.0, 100.0, Pose(100.0, 100.0))
    assert FaultKind.POSE_JUMP not in kinds(monitor)
    assert FaultKind.POLICY_ERROR not in kinds(monitor)


@pytest.mark.parametrize("step", [0.0, 0.01, -0.02], ids=["same stamps", "later stamps", "earlier stamps"])
@pytest.mark.parametrize("other", [(0.5, 0.0), (0.0, 0.3)], ids=["places", "headings"])
def test_two_publishers_of_the_pose_that_disagree_are_a_fault(step, other):
    monitor = healthy()
    for k in range(4):
        stamp, x = 100.05 + 0.05 * k, 1.0 + 0.05 * k
        monitor.heard_pose(10.0 + 0.05 * k, stamp, Pose(x, 1.0, 0.0))
        monitor.heard_pose(10.0 + 0.05 * k, stamp + step, Pose(x, 1.0 + other[0], other[1]))
    (fault,) = monitor.check(10.2)
    assert fault.kind is FaultKind.POSE_JUMP and "two nodes publish" in fault.reason
    for k in range(30):
        monitor.heard_sensor(10.2 + 0.1 * k)
        monitor.updated_map(10.2 + 0.1 * k)
        monitor.heard_pose(10.2 + 0.1 * k, 101.0 + 0.1 * k, Pose(1.5, 1.0))
    assert kinds(monitor, 13.1) == set()


def test_driving_back_late_poses_and_one_correction_are_no_two_publishers():
    monitor = healthy()
    places = [1.0, 1.2, 1.4, 1.2, 1.0, 1.2, 1.4, 2.1, 1.4, 1.2]
    for k, x in enumerate(places):
        monitor.heard_pose(10.0 + 0.1 * k, 100.1 + 0.1 * k, Pose(x, 1.0))
        monitor.heard_pose(10.0 + 0.1 * k, 100.05 + 0.1 * k, Pose(x - 0.1, 1.0))
    assert not any("two nodes" in fault.reason for fault in monitor.check(11.0))
