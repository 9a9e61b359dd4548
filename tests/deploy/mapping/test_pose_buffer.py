"""Poses at the moment of a scan."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.geometry import Pose
from deploy.mapping.pose_buffer import PoseBuffer


def buffer_of(*poses: tuple[float, Pose]) -> PoseBuffer:
    buffer = PoseBuffer()
    for time, pose in poses:
        buffer.add(time, pose)
    return buffer


def test_poses_between_two_messages_lie_on_the_way():
    buffer = buffer_of((1.0, Pose(0.0, 0.0, 0.0)), (1.1, Pose(1.0, -2.0, 0.4)))
    pose, _ = buffer.at(1.025, 0.2)
    assert (pose.x, pose.y, pose.yaw) == pytest.approx((0.25, -0.5, 0.1))


def test_yaw_turns_the_short_way_over_pi():
    buffer = buffer_of((0.0, Pose(0.0, 0.0, 3.1)), (0.2, Pose(0.0, 0.0, -3.1)))
    pose, _ = buffer.at(0.1, 0.2)
    assert abs(pose.yaw) == pytest.approx(np.pi, abs=1e-9)


def test_order_of_arrival_does_not_matter():
    poses = [(k / 10, Pose(float(k), 0.0)) for k in range(20)]
    shuffled = np.random.default_rng(0).permutation(20)
    buffer = buffer_of(*(poses[k] for k in shuffled))
    assert buffer.newest[0] == 1.9
    assert buffer.at(0.55, 0.2)[0].x == pytest.approx(5.5)


def test_nothing_is_told_farther_from_a_pose_than_the_tolerance():
    buffer = buffer_of((1.0, Pose(1.0, 0.0)), (5.0, Pose(9.0, 0.0)))
    assert buffer.at(0.7, 0.2) is None
    assert buffer.at(0.85, 0.2)[0].x == 1.0
    assert buffer.at(5.15, 0.2)[0].x == 9.0
    assert buffer.at(5.3, 0.2) is None
    assert buffer.at(3.0, 0.2) is None, "a gap of four seconds is not bridged"
    assert buffer.at(4.9, 0.2)[0].x == 9.0, "the nearer pose counts, the way across the gap does not"


def test_memory_is_bounded():
    buffer = PoseBuffer(seconds=2.0, count=500)
    for k in range(20_000):
        buffer.add(k / 200, Pose(float(k), 0.0))
    assert len(buffer) <= 500
    assert buffer.at(19_999 / 200, 0.1)[0].x == 19_999


def test_a_clock_set_back_begins_anew():
    buffer = buffer_of((100.0, Pose(1.0, 0.0)), (100.1, Pose(1.1, 0.0)))
    buffer.add(0.5, Pose(7.0, 0.0))
    assert buffer.newest[0] == 0.5
    assert buffer.at(0.5, 0.2)[0].x == 7.0


def test_a_pose_that_is_not_finite_is_left_out():
    buffer = buffer_of((1.0, Pose(1.0, 0.0)))
    assert not buffer.add(1.1, Pose(float("nan"), 0.0))
    assert not buffer.add(float("inf"), Pose(0.0, 0.0))
    assert len(buffer) == 1


@given(st.lists(st.tuples(st.integers(0, 60), st.floats(-3.1, 3.1)), min_size=1, max_size=40), st.floats(0.0, 6.0))
def test_an_answer_lies_between_its_neighbours(messages, time):
    buffer = buffer_of(*((k / 10, Pose(k / 10, -k / 5, yaw)) for k, yaw in messages))
    found = buffer.at(time, 0.2)
    times = sorted({k / 10 for k, _ in messages})
    nearest = min(abs(time - t) for t in times)
    assert (found is None) == (nearest > 0.2)
    if found is not None:
        assert abs(found[0].x - time) <= 0.2 + 1e-9
        assert found[0].y == pytest.approx(-2.0 * found[0].x)
        assert -np.pi <= found[0].yaw <= np.pi
