import math

import pytest

from common.geometry import Pose
from deploy.config import SafetyConfig
from deploy.safety.health import FaultKind, HealthMonitor

FENCE = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0))


def healthy(now: float = 10.0, **config) -> HealthMonitor:
    monitor = HealthMonitor(SafetyConfig(**config))
    monitor.heard_sensor(now)
    monitor.updated_map(now)
    monitor.heard_pose(now, 100.0, Pose(1.0, 1.0))
    return monitor


def kinds(monitor: HealthMonitor, now: float = 10.0, **arguments) -> set[FaultKind]:
    return {fault.kind for fault in monitor.check(now, **arguments)}


def test_all_is_well():
    assert kinds(healthy()) == set()


def test_nothing_heard_yet():
    faults = HealthMonitor(SafetyConfig(), sensor="points").check(0.0)
    assert {fault.kind for fault in faults} == {FaultKind.SENSOR_STALE, FaultKind.POSE_STALE, FaultKind.MAP_STALE}
    assert faults[0].reason == "no points has come yet"


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


def test_clock_set_back_is_no_jump_but_a_far_pose_is():
    monitor = healthy()
    monitor.heard_pose(10.1, 5.0, Pose(1.2, 1.0))
    assert kinds(monitor, 10.1) == set()
    monitor.heard_pose(10.2, 1.0, Pose(9.0, 1.0))
    assert kinds(monitor, 10.2) == {FaultKind.POSE_JUMP}


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
