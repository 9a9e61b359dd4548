"""A pose must show the motion that the wheels make."""

import pytest

from common.geometry import Pose
from deploy.safety.motion import MotionWatch


def drive(watch, seconds, *, v=1.0, w=0.0, shows=1.0, start=0.0, lag=0.0, by="commanded", period=0.05, pace=1.0):
    """Tell velocities and poses at 20 Hz; return (the time of the first fault or None, the last pose)."""
    x = yaw = 0.0
    first = None
    for k in range(round(seconds / period)):
        now = start + k * period
        getattr(watch, by)(now, v, w)
        if now - start >= lag:
            x, yaw = x + shows * v * period, yaw + shows * w * period
        watch.heard_pose(now, now * pace, Pose(x, 0.0, yaw))
        if watch.fault(now) and first is None:
            first = now - start
    return first, now


@pytest.mark.parametrize(("v", "w"), [(1.0, 0.0), (0.2, 0.0), (-0.1, 0.0), (0.0, 1.0), (0.5, 0.5)])
def test_a_robot_that_moves_as_told_is_well(v, w):
    assert drive(MotionWatch(), 10.0, v=v, w=w)[0] is None


def test_a_slow_start_is_no_fault():
    assert drive(MotionWatch(), 5.0, v=0.5, lag=0.5)[0] is None
    assert drive(MotionWatch(), 5.0, v=1.0, shows=0.3)[0] is None


@pytest.mark.parametrize("by", ["commanded", "measured"])
@pytest.mark.parametrize(("v", "w", "limit"), [(1.0, 0.0, 0.4), (0.3, 0.0, 1.2), (0.0, 1.0, 0.6), (0.1, 0.0, 3.2)])
def test_a_pose_that_stands_is_found_within_a_third_of_a_metre_or_half_a_radian(by, v, w, limit):
    first, _ = drive(MotionWatch(), 5.0, v=v, w=w, shows=0.0, by=by)
    assert first is not None
    assert first <= limit


def test_a_simulation_in_slow_motion_moves_as_told():
    assert drive(MotionWatch(), 10.0, shows=0.05, pace=0.05)[0] is None


def test_a_robot_at_rest_or_without_a_command_is_well():
    watch = MotionWatch()
    assert drive(watch, 60.0, v=0.0, shows=0.0)[0] is None
    watch.commanded(60.0, 0.5, 0.0)
    for k in range(100):
        watch.heard_pose(60.0 + 0.1 * k, 0.1 * k, Pose(0.0, 0.0))
        assert not watch.fault(60.0 + 0.1 * k), "one command lasts half a second"


def test_turning_left_and_right_on_the_spot_is_no_way():
    watch = MotionWatch()
    for k in range(400):
        watch.commanded(0.05 * k, 0.0, 1.0 if k % 4 < 2 else -1.0)
        watch.heard_pose(0.05 * k, 0.05 * k, Pose(0.0, 0.0, 0.05 * (k % 2)))
        assert watch.fault(0.05 * k) == ""


def test_the_fault_ends_when_the_pose_moves_by_a_command_or_for_another_try():
    watch = MotionWatch()
    _, now = drive(watch, 2.0, shows=0.0)
    assert "the pose does not change while the robot was commanded to move" in watch.fault(now)
    assert "does its base hear the velocities (`hd-deploy topics`)" in watch.fault(now)
    watch.heard_pose(now, now, Pose(0.02, 0.0))
    assert watch.fault(now + 5.0)
    watch.heard_pose(now, now, Pose(0.6, 0.0))
    assert watch.fault(now) == ""

    _, now = drive(watch, 2.0, shows=0.0, start=10.0)
    assert watch.fault(now)
    watch.forgive()
    assert watch.fault(now) == ""

    start = 20.0
    for wait in (30.0, 60.0, 120.0):
        first, now = drive(watch, 2.0, shows=0.0, start=start)
        assert first is not None
        assert watch.fault(start + first + wait - 0.1)
        assert watch.fault(start + first + wait + 0.1) == ""
        start += first + wait + 1.0
