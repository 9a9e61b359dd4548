import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.geometry import Pose
from deploy.ros2 import conversions as convert
from deploy.ros2.errors import RosError
from deploy.ros2.messages import message
from tests.deploy.ros2.wire import close, few, metres, over_the_wire, poses, stamps


@given(stamps, poses, st.floats(-2, 2), st.floats(-3, 3))
def test_odometry_round_trips(stamp, pose, speed, turn):
    odometry = convert.odometry(stamp, "map", "base_link", pose, (speed, turn))
    back = over_the_wire(odometry, "nav_msgs/msg/Odometry")
    when, where, velocity = convert.pose_from(back)
    assert when == pytest.approx(stamp, abs=1e-6)
    assert close(where, pose)
    assert velocity == (speed, turn)
    assert (back.header.frame_id, back.child_frame_id) == ("map", "base_link")


@given(stamps, poses)
def test_transforms_round_trip(stamp, pose):
    tf = convert.transform_message([convert.transform(stamp, "/map", "odom", pose, 0.5)])
    ((when, parent, child, shift, rotation),) = convert.transforms_from(over_the_wire(tf, "tf2_msgs/msg/TFMessage"))
    assert when == pytest.approx(stamp, abs=1e-6)
    assert (parent, child) == ("map", "odom")
    assert shift == (pose.x, pose.y, 0.5)
    assert 2 * math.atan2(rotation[2], rotation[3]) == pytest.approx(pose.yaw)


@few
@given(stamps, poses, st.lists(st.tuples(metres, metres), max_size=5))
def test_goals_and_paths_round_trip(stamp, pose, route):
    point = over_the_wire(convert.point_stamped(stamp, "map", pose.position), "geometry_msgs/msg/PointStamped")
    assert convert.position_from(point)[1] == pose.position
    goal = over_the_wire(convert.pose_stamped(stamp, "map", pose), "geometry_msgs/msg/PoseStamped")
    assert close(convert.pose_from_stamped(goal)[1], pose)
    path = over_the_wire(convert.path(stamp, "map", route), "nav_msgs/msg/Path")
    assert convert.path_from(path) == route
    assert all(one.header.frame_id == "map" for one in path.poses)


def test_poses_of_a_path_look_ahead():
    path = convert.path(0.0, "map", [(0.0, 0.0), (0.0, 1.0), (-1.0, 1.0)])
    assert [convert.yaw_of(one.pose.orientation) for one in path.poses] == pytest.approx(
        [math.pi / 2, math.pi, math.pi]
    )


def test_rotations_need_a_length():
    with pytest.raises(RosError, match="quaternion"):
        convert.yaw_of(message("geometry_msgs/msg/Quaternion", w=0.0))
    rounded = message("geometry_msgs/msg/Quaternion", z=1.01 * math.sin(0.5), w=1.01 * math.cos(0.5))
    assert convert.yaw_of(rounded) == pytest.approx(1.0)


def test_tilted_poses_keep_their_heading():
    # Yaw 0.5, then pitch 0.2: x, y, z, w by multiplying both quaternions.
    half_yaw, half_pitch = 0.25, 0.1
    tilted = message(
        "geometry_msgs/msg/Quaternion",
        x=-math.sin(half_yaw) * math.sin(half_pitch),
        y=math.cos(half_yaw) * math.sin(half_pitch),
        z=math.sin(half_yaw) * math.cos(half_pitch),
        w=math.cos(half_yaw) * math.cos(half_pitch),
    )
    assert convert.yaw_of(tilted) == pytest.approx(0.5)


def test_poses_whose_z_axis_points_down_are_refused_by_name():
    ned = message("geometry_msgs/msg/Quaternion", x=1.0, w=0.0)
    with pytest.raises(RosError, match="NED"):
        convert.yaw_of(ned)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_places_that_are_not_finite_are_refused(value):
    odometry = convert.odometry(1.0, "map", "base", Pose(0.0, 0.0))
    odometry.pose.pose.position.x = value
    with pytest.raises(RosError, match="finite"):
        convert.pose_from(odometry)
    with pytest.raises(RosError, match="finite"):
        convert.position_from(convert.point_stamped(1.0, "map", (0.0, value)))


@pytest.mark.parametrize("value", [1e9, -1e300])
def test_places_beyond_reason_are_refused_by_name(value):
    with pytest.raises(RosError, match="finite metres of at most 1e"):
        convert.pose_from(convert.odometry(1.0, "map", "base", Pose(value, 0.0)))
    with pytest.raises(RosError, match="velocity"):
        convert.pose_from(convert.odometry(1.0, "map", "base", Pose(0.0, 0.0), (value, 0.0)))
    with pytest.raises(RosError, match="velocity"):
        convert.pose_from(convert.odometry(1.0, "map", "base", Pose(0.0, 0.0), (0.0, float("nan"))))
    with pytest.raises(RosError, match="a point"):
        convert.position_from(convert.point_stamped(1.0, "map", (value, 0.0)))


@pytest.mark.parametrize(("z", "w"), [(1.57, 0.0), (1.57, 1.0), (90.0, 1.0), (math.nan, 1.0)])
def test_a_yaw_in_the_place_of_a_quaternion_is_refused_but_for_goals_which_are_places(z, w):
    odometry = convert.odometry(1.0, "odom", "base_link", Pose(1.0, 2.0, 0.5))
    goal = convert.pose_stamped(1.0, "map", Pose(1.0, 2.0, 0.5))
    for pose in (odometry.pose.pose, goal.pose):
        pose.orientation = message("geometry_msgs/msg/Quaternion", z=z, w=w)
    with pytest.raises(RosError, match=r"length 1, got .*a yaw in radians is"):
        convert.pose_from(odometry)
    assert convert.pose_from_stamped(goal) == (1.0, Pose(1.0, 2.0, 0.0))


def test_a_rotation_that_was_never_set_is_none_for_goals_but_wrong_for_poses_of_the_robot():
    goal = convert.pose_stamped(1.0, "map", Pose(1.0, 2.0, 0.5))
    goal.pose.orientation = message("geometry_msgs/msg/Quaternion")
    goal.pose.orientation.w = 0.0
    assert convert.pose_from_stamped(goal) == (1.0, Pose(1.0, 2.0, 0.0))
    odometry = convert.odometry(1.0, "odom", "base_link", Pose(1.0, 2.0, 0.5))
    odometry.pose.pose.orientation = goal.pose.orientation
    with pytest.raises(RosError, match="quaternion"):
        convert.pose_from(odometry)
