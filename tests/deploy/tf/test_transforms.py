"""Frames of the robot: chains, time, rotations in space."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import MappingError
from deploy.tf.transform import Transform, interpolated
from deploy.tf.transforms import TransformTree

NUMBERS = st.floats(-50.0, 50.0)


@st.composite
def transforms(draw):
    vector = np.array([draw(st.floats(-1.0, 1.0)) for _ in range(4)]) + np.array([0.0, 0.0, 0.0, 1.5])
    x, y, z, w = (float(v) for v in vector / np.linalg.norm(vector))
    return Transform((draw(NUMBERS), draw(NUMBERS), draw(NUMBERS)), (x, y, z, w))


@given(transforms(), transforms())
def test_chains_move_points_as_their_parts_do(first, second):
    points = np.array([[1.0, 2.0, 3.0], [-4.0, 0.5, 0.0]])
    np.testing.assert_allclose((first @ second).apply(points), first.apply(second.apply(points)), atol=1e-9)
    np.testing.assert_allclose(first.inverse().apply(first.apply(points)), points, atol=1e-9)
    np.testing.assert_allclose(first.matrix() @ first.matrix().T, np.eye(3), atol=1e-12)


@given(transforms(), transforms(), st.floats(0.0, 1.0))
def test_interpolation_turns_at_a_constant_rate(old, new, share):
    def angle(a, b):
        return 2.0 * np.arccos(min(abs(float(np.dot(a.rotation, b.rotation))), 1.0))

    between = interpolated(old, new, share)
    assert np.linalg.norm(between.rotation) == pytest.approx(1.0)
    assert angle(old, between) == pytest.approx(share * angle(old, new), abs=1e-6)


def yaw_about_z(yaw: float) -> tuple[float, float, float, float]:
    return 0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2))


def robot_tree() -> TransformTree:
    """map -> odom (corrected once) -> base_link (20 Hz, 1 m/s along x) -> lidar (static, upside down)."""
    tree = TransformTree()
    tree.add(0.0, "map", "odom", (10.0, 5.0, 0.0), yaw_about_z(np.pi / 2))
    for k in range(21):
        tree.add(k / 20, "odom", "base_link", (k / 20, 0.0, 0.0), yaw_about_z(0.0))
    tree.add(0.0, "base_link", "lidar", (0.2, 0.0, 0.5), (1.0, 0.0, 0.0, 0.0), static=True)
    return tree


def test_map_to_base_is_the_chain_over_odom():
    pose = robot_tree().lookup("map", "base_link", 0.525, 0.2).pose
    assert (pose.x, pose.y, pose.yaw) == pytest.approx((10.0, 5.525, np.pi / 2))


def test_a_slow_correction_does_not_hold_up_a_fast_odometry():
    tree = robot_tree()
    assert tree.newest("map", "base_link") == 1.0
    assert tree.lookup("map", "base_link", 1.0, 0.0) is not None
    assert tree.lookup("map", "base_link", 1.3, 0.2) is None, "the odometry is too old"
    for k in range(21, 200):
        tree.add(k / 20, "odom", "base_link", (k / 20, 0.0, 0.0), yaw_about_z(0.0))
    assert tree.lookup("map", "base_link", 9.0, 0.2) is None, "the correction is nine seconds old"


def test_static_links_hold_for_ever_and_in_both_directions():
    tree = robot_tree()
    there = tree.lookup("base_link", "lidar", 1e6, 0.0)
    back = tree.lookup("lidar", "base_link", 1e6, 0.0)
    assert there.translation == (0.2, 0.0, 0.5)
    np.testing.assert_allclose((there @ back).apply(np.array([[1.0, 2.0, 3.0]])), [[1.0, 2.0, 3.0]], atol=1e-12)
    assert there.matrix()[2, 2] == pytest.approx(-1.0)


def test_siblings_are_found_over_their_common_parent():
    tree = robot_tree()
    tree.add(0.0, "/base_link", "/camera", (0.5, 0.0, 0.0), yaw_about_z(0.0), static=True)
    assert tree.lookup("camera", "lidar", 0.5, 0.1).translation == pytest.approx((-0.3, 0.0, 0.5))
    assert tree.lookup("camera", "elsewhere", 0.5, 0.1) is None
    assert tree.newest("map", "elsewhere") is None


def test_odometry_out_of_order_is_sorted_in():
    tree = TransformTree()
    for k in (3, 0, 2, 1):
        tree.add(k / 10, "odom", "base_link", (float(k), 0.0, 0.0), yaw_about_z(0.0))
    assert tree.lookup("odom", "base_link", 0.15, 0.1).translation[0] == pytest.approx(1.5)


def test_rings_and_numbers_that_are_no_transform_are_refused():
    tree = robot_tree()
    with pytest.raises(MappingError, match="two publishers"):
        tree.add(0.0, "base_link", "map", (0.0, 0.0, 0.0), yaw_about_z(0.0))
    with pytest.raises(MappingError, match="unit quaternion"):
        tree.add(0.0, "map", "odom", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))
    with pytest.raises(MappingError, match="finite"):
        tree.add(0.0, "map", "odom", (float("nan"), 0.0, 0.0), yaw_about_z(0.0))
    assert tree.lookup("map", "base_link", 0.5, 0.1) is not None


def test_memory_is_bounded():
    tree = TransformTree(seconds=2.0)
    for k in range(5000):
        tree.add(k / 100, "odom", "base_link", (float(k), 0.0, 0.0), yaw_about_z(0.0))
    assert len(tree._links["base_link"].times) < 500


def test_a_static_transform_that_is_published_with_other_numbers_is_named():
    tree = TransformTree()
    for turn in (0.3, 0.3 + 1e-9):
        tree.add(0.0, "base_link", "laser", (0.2, 0.0, 0.0), yaw_about_z(turn), static=True)
    assert tree.changed == ""
    tree.add(0.0, "base_link", "laser", (0.2, 0.0, 0.1), yaw_about_z(0.3), static=True)
    assert "base_link -> laser changed from (0.2, 0.0, 0.0)" in tree.changed and "stop one" in tree.changed
