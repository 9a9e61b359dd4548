"""Leaving the fence and coming back, by odometry and by transforms."""

from common.geometry import Pose
from deploy.network_config import FramesConfig, TopicsConfig
from deploy.ros2.conversions import odometry, transform, transform_message
from deploy.safety.fence_watch import FenceWatch
from deploy.safety.geofence import Geofence

SQUARE = [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)]


def watch(pose: str) -> tuple[FenceWatch, list[str]]:
    told: list[str] = []
    return FenceWatch(Geofence(SQUARE), TopicsConfig(), FramesConfig(), told.append, by_tf=pose == "tf"), told


def test_crossings_are_told_once_each():
    fence, told = watch("odometry")
    for x in (1.0, 3.9, 4.1, 5.0, 6.0, 3.0, 2.0):
        fence.take_odometry(odometry(1.0, "map", "base_link", Pose(x, 1.0)), None)
    assert told == ["(4.10, 1.00)", ""]


def test_a_long_robot_may_leave_by_a_turn():
    told: list[str] = []
    fence = Geofence(SQUARE, outline=[(1.0, 0.2), (-0.2, 0.2), (-0.2, -0.2), (1.0, -0.2)])
    watch = FenceWatch(fence, TopicsConfig(), FramesConfig(), told.append)
    for yaw in (1.5, 0.0, 1.5):
        watch.take_odometry(odometry(1.0, "map", "base_link", Pose(3.5, 1.0, yaw)), None)
    assert told == ["(3.50, 1.00)", ""]


def test_a_robot_may_begin_outside():
    fence, told = watch("odometry")
    fence.take_odometry(odometry(1.0, "map", "base_link", Pose(-3.0, 1.0)), None)
    assert told == ["(-3.00, 1.00)"]


def test_the_pose_by_transforms_is_that_of_the_map_frame():
    fence, told = watch("tf")
    fence.take_static_transforms(
        transform_message([transform(0.0, "base_footprint", "base_link", Pose(0.0, 0.0), 0.1)]), None
    )
    fence.take_transforms(transform_message([transform(1.0, "odom", "base_footprint", Pose(-5.0, 1.0))]), None)
    assert told == [], "where odom lies in the map is not known yet"
    fence.take_transforms(transform_message([transform(1.0, "map", "odom", Pose(7.0, 0.0))]), None)
    assert told == []
    fence.take_transforms(transform_message([transform(1.1, "map", "odom", Pose(10.0, 0.0))]), None)
    fence.take_transforms(transform_message([transform(1.2, "odom", "base_footprint", Pose(-5.0, 1.0))]), None)
    assert told == ["(5.00, 1.00)"], "a correction by SLAM can show that it is outside"
    fence.take_transforms(transform_message([transform(1.3, "odom", "base_footprint", Pose(-7.0, 1.0))]), None)
    assert told == ["(5.00, 1.00)", ""]


def test_a_pose_that_was_overtaken_does_not_bring_the_robot_back():
    fence, told = watch("odometry")
    for stamp, x in ((1.0, 1.0), (1.2, 5.0), (1.1, 2.0)):
        fence.take_odometry(odometry(stamp, "map", "base_link", Pose(x, 1.0)), None)
    assert told == ["(5.00, 1.00)"]


def test_a_clock_that_was_set_back_hides_nothing():
    fence, told = watch("tf")
    for stamp, x in ((100.0, 1.0), (100.1, 1.0), (95.0, 1.0), (95.1, 1.0), (95.2, 5.0)):
        moved = [transform(stamp, "map", "odom", Pose(0.0, 0.0)), transform(stamp, "odom", "base_link", Pose(x, 1.0))]
        fence.take_transforms(transform_message(moved), None)
    assert told == ["(5.00, 1.00)"]
