import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from common.geometry import Pose, Scan
from deploy.ros2 import conversions as convert
from deploy.ros2.errors import RosError
from deploy.ros2.messages import deserialize, header, message, serialize

# Arrays are slow to draw.
few = settings(max_examples=25)
metres = st.floats(-1e4, 1e4)
angles = st.floats(-3.1, 3.1)
stamps = st.floats(0.0, 2e9)
poses = st.builds(Pose, metres, metres, angles)
CLOUD = "sensor_msgs/msg/PointCloud2"


def over_the_wire(value, kind):
    return deserialize(serialize(value, kind), kind)


def close(a: Pose, b: Pose) -> bool:
    turn = math.remainder(a.yaw - b.yaw, 2 * math.pi)
    return a.x == b.x and a.y == b.y and abs(turn) < 1e-9


@few
@given(
    stamps,
    hnp.arrays(np.float32, st.integers(0, 50), elements=st.floats(0, 100, width=32)),
    st.floats(-3.0, 3.0, width=32),
    st.floats(0.0009765625, 0.125, width=32),
)
def test_scans_round_trip(stamp, ranges, first, step):
    scan = Scan(ranges, first, step, 20.0, 0.25)
    there = over_the_wire(convert.laser_scan(stamp, "laser", scan), "sensor_msgs/msg/LaserScan")
    back = convert.scan_from(there)
    assert np.array_equal(back.ranges, ranges)
    assert (back.angle_min, back.angle_increment, back.range_max, back.range_min) == (first, step, 20.0, 0.25)
    assert there.angle_max == pytest.approx(first + max(len(ranges) - 1, 0) * step, abs=1e-4)


@pytest.mark.parametrize(
    ("field", "value"),
    [("angle_min", math.nan), ("angle_increment", 0.0), ("range_max", math.nan), ("range_min", 30.0)],
)
def test_scans_without_sense_are_refused(field, value):
    scan = convert.laser_scan(0.0, "laser", Scan(np.ones(3, np.float32), 0.0, 0.1, 20.0))
    setattr(scan, field, value)
    with pytest.raises(RosError, match="LaserScan"):
        convert.scan_from(scan)


@few
@given(
    st.integers(3, 4).flatmap(
        lambda columns: hnp.arrays(
            np.float32, st.tuples(st.integers(0, 40), st.just(columns)), elements=st.floats(-100, 100, width=32)
        )
    )
)
def test_clouds_round_trip(points):
    there = over_the_wire(convert.point_cloud(1.0, "map", points), CLOUD)
    assert np.array_equal(convert.points_from(there), points)
    assert there.is_dense


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("size", ["f4", "f8"])
@few
@given(
    hnp.arrays(
        np.float32, st.tuples(st.integers(1, 4), st.integers(1, 6), st.just(4)), elements=st.floats(-9, 9, width=32)
    ),
    st.permutations(["x", "y", "z", "intensity"]),
    st.integers(0, 7),
    st.integers(0, 5),
)
def test_clouds_of_any_layout_are_read(order, size, points, names, gap, tail):
    """Organised clouds, other field orders, gaps, padded rows, doubles, big endian."""
    rows, columns, _ = points.shape
    width = np.dtype(size).itemsize
    offsets = [gap + (width + gap) * number for number in range(4)]
    layout = np.dtype(
        {
            "names": names,
            "formats": [order + size] * 4,
            "offsets": offsets,
            "itemsize": offsets[-1] + width + gap,
        }
    )
    grid = np.zeros((rows, columns), layout)
    for number, name in enumerate(("x", "y", "z", "intensity")):
        grid[name] = points[:, :, number]
    row_step = columns * layout.itemsize + tail
    data = np.zeros((rows, row_step), np.uint8)
    data[:, : row_step - tail] = np.frombuffer(grid.tobytes(), np.uint8).reshape(rows, -1)
    cloud = message(
        CLOUD,
        height=rows,
        width=columns,
        is_bigendian=order == ">",
        fields=[
            message("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=7 if size == "f4" else 8, count=1)
            for name, offset in zip(names, offsets, strict=True)
        ],
        point_step=layout.itemsize,
        row_step=row_step,
        data=data.reshape(-1),
    )
    assert np.array_equal(convert.points_from(over_the_wire(cloud, CLOUD)), points.reshape(-1, 4))


def test_points_that_are_not_finite_are_left_out():
    points = np.array([[1, 2, 3], [np.nan, 2, 3], [1, np.inf, 3], [4, 5, 6]], np.float32)
    cloud = convert.point_cloud(1.0, "map", points)
    assert not cloud.is_dense
    assert np.array_equal(convert.points_from(cloud), points[[0, 3]])


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("width", 4_000_000_000, "row_step"),
        ("height", 1000, "bytes"),
        ("point_step", 8, "point_step"),
        ("row_step", 1, "row_step"),
        ("data", np.zeros(5, np.uint8), "bytes"),
        ("fields", [], "x, y, z lacks"),
    ],
)
def test_clouds_that_lie_about_their_size_are_refused(field, value, words):
    cloud = convert.point_cloud(1.0, "map", np.ones((10, 3), np.float32))
    setattr(cloud, field, value)
    with pytest.raises(RosError, match=words):
        convert.points_from(cloud)


@given(st.data())
def test_clouds_with_any_numbers_parse_or_are_refused(data):
    number = st.integers(0, 2**32 - 1) | st.integers(0, 40)
    cloud = convert.point_cloud(1.0, "map", np.ones((3, 3), np.float32))
    for name in ("height", "width", "point_step", "row_step"):
        if data.draw(st.booleans()):
            setattr(cloud, name, data.draw(number))
    cloud.fields[0].offset = data.draw(number)
    cloud.fields[1].datatype = data.draw(st.integers(0, 255) | st.integers(1, 8))
    try:
        points = convert.points_from(over_the_wire(cloud, CLOUD))
    except RosError as error:
        assert "PointCloud2" in str(error)
    else:
        assert points.dtype == np.float32


def test_a_cloud_of_30000_points_takes_well_below_a_millisecond():
    cloud = over_the_wire(convert.point_cloud(1.0, "map", np.ones((30_000, 4), np.float32)), CLOUD)
    best = math.inf
    for _ in range(50):
        start = time.perf_counter()
        points = convert.points_from(cloud)
        best = min(best, time.perf_counter() - start)
    assert points.shape == (30_000, 4)
    assert best < 0.5e-3


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
@given(
    hnp.arrays(np.int8, st.tuples(st.integers(0, 12), st.integers(0, 12)), elements=st.integers(-128, 127)),
    st.floats(0.0078125, 2.0, width=32),
    poses,
)
def test_grids_round_trip(cells, resolution, corner):
    there = over_the_wire(
        convert.occupancy_grid(1.0, "map", cells, resolution, (corner.x, corner.y, corner.yaw)),
        "nav_msgs/msg/OccupancyGrid",
    )
    back, size, (x, y, yaw) = convert.grid_from(there)
    assert np.array_equal(back, cells)
    assert size == resolution
    assert close(Pose(x, y, yaw), corner)


@pytest.mark.parametrize(("field", "value"), [("width", 99), ("height", 2**31), ("resolution", 0.0)])
def test_grids_that_lie_are_refused(field, value):
    grid = convert.occupancy_grid(1.0, "map", np.zeros((3, 4), np.int8), 0.1)
    setattr(grid.info, field, value)
    with pytest.raises(RosError, match="OccupancyGrid"):
        convert.grid_from(grid)


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


@given(st.floats(-2, 2), st.floats(-3, 3))
def test_velocities_round_trip(linear, angular):
    plain = over_the_wire(convert.twist(linear, angular), "geometry_msgs/msg/Twist")
    stamped = over_the_wire(convert.twist_stamped(1.0, "base", linear, angular), "geometry_msgs/msg/TwistStamped")
    assert convert.velocity_from(plain) == convert.velocity_from(stamped) == (linear, angular)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_what_is_not_finite_is_refused(value):
    odometry = convert.odometry(1.0, "map", "base", Pose(0.0, 0.0))
    odometry.pose.pose.position.x = value
    with pytest.raises(RosError, match="finite"):
        convert.pose_from(odometry)
    with pytest.raises(RosError, match="finite"):
        convert.velocity_from(convert.twist(value, 0.0))
    with pytest.raises(RosError, match="finite"):
        convert.position_from(convert.point_stamped(1.0, "map", (0.0, value)))


def test_rotations_need_a_length():
    with pytest.raises(RosError, match="quaternion"):
        convert.yaw_of(message("geometry_msgs/msg/Quaternion", w=0.0))
    rounded = message("geometry_msgs/msg/Quaternion", z=1.01 * math.sin(0.5), w=1.01 * math.cos(0.5))
    assert convert.yaw_of(rounded) == pytest.approx(1.0)


@pytest.mark.parametrize(("z", "w"), [(1.57, 0.0), (1.57, 1.0), (90.0, 1.0), (math.nan, 1.0)])
def test_a_yaw_in_the_place_of_a_quaternion_is_refused_but_for_goals_which_are_places(z, w):
    grid = convert.occupancy_grid(1.0, "map", np.zeros((2, 3), np.int8), 0.5, (1.0, 2.0, 0.5))
    odometry = convert.odometry(1.0, "odom", "base_link", Pose(1.0, 2.0, 0.5))
    goal = convert.pose_stamped(1.0, "map", Pose(1.0, 2.0, 0.5))
    for pose in (grid.info.origin, odometry.pose.pose, goal.pose):
        pose.orientation = message("geometry_msgs/msg/Quaternion", z=z, w=w)
    with pytest.raises(RosError, match=r"length 1, got .*a yaw in radians is"):
        convert.grid_from(grid)
    with pytest.raises(RosError, match=r"length 1, got .*a yaw in radians is"):
        convert.pose_from(odometry)
    assert convert.pose_from_stamped(goal) == (1.0, Pose(1.0, 2.0, 0.0))


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


def test_stamps_of_headers():
    assert header(12.25, "map").stamp.nanosec == 250_000_000


@pytest.mark.parametrize("value", [1e9, -1e300])
def test_what_is_beyond_reason_is_refused_by_name(value):
    with pytest.raises(RosError, match="finite metres of at most 1e"):
        convert.pose_from(convert.odometry(1.0, "map", "base", Pose(value, 0.0)))
    with pytest.raises(RosError, match="velocity"):
        convert.pose_from(convert.odometry(1.0, "map", "base", Pose(0.0, 0.0), (value, 0.0)))
    with pytest.raises(RosError, match="velocity"):
        convert.pose_from(convert.odometry(1.0, "map", "base", Pose(0.0, 0.0), (0.0, float("nan"))))
    with pytest.raises(RosError, match="a point"):
        convert.position_from(convert.point_stamped(1.0, "map", (value, 0.0)))
    with pytest.raises(RosError, match="resolution"):
        convert.grid_from(convert.occupancy_grid(1.0, "map", np.zeros((2, 2), np.int8), 1e4))
    with pytest.raises(RosError, match="radians.*degrees"):
        convert.scan_from(convert.laser_scan(1.0, "laser", Scan(np.ones(4, np.float32), -180.0, 0.5, 30.0)))
    with pytest.raises(RosError, match="metres.*millimetres"):
        convert.scan_from(convert.laser_scan(1.0, "laser", Scan(np.ones(4, np.float32), 0.0, 0.5, 3e4, 100.0)))
    with pytest.raises(RosError, match="at most 131072 beams"):
        convert.scan_from(convert.laser_scan(1.0, "laser", Scan(np.ones(200_000, np.float32), 0.0, 1e-4, 30.0)))


def test_a_scan_without_a_limit_is_taken():
    scan = convert.laser_scan(1.0, "laser", Scan(np.full(360, 3.0, np.float32), -math.pi, math.radians(1.0), 20.0, 0.1))
    scan.range_max = math.inf
    back = convert.scan_from(scan)
    assert math.isfinite(back.range_max) and back.range_max > 1e30
    assert back.ranges.tolist() == scan.ranges.tolist()


def test_a_rotation_that_was_never_set_is_none_for_goals_and_maps_but_wrong_for_poses_of_the_robot():
    goal = convert.pose_stamped(1.0, "map", Pose(1.0, 2.0, 0.5))
    goal.pose.orientation = message("geometry_msgs/msg/Quaternion")
    goal.pose.orientation.w = 0.0
    assert convert.pose_from_stamped(goal) == (1.0, Pose(1.0, 2.0, 0.0))
    grid = convert.occupancy_grid(1.0, "map", np.zeros((2, 3), np.int8), 0.5, (1.0, 2.0, 0.5))
    grid.info.origin.orientation = goal.pose.orientation
    assert convert.grid_from(grid)[2] == (1.0, 2.0, 0.0)
    odometry = convert.odometry(1.0, "odom", "base_link", Pose(1.0, 2.0, 0.5))
    odometry.pose.pose.orientation = goal.pose.orientation
    with pytest.raises(RosError, match="quaternion"):
        convert.pose_from(odometry)
