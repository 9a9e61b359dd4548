"""Legal messages that few drivers send are taken; what contradicts itself is named."""

import copy
import re
from math import cos, pi, sin

import numpy as np
import pytest

from common.errors import ConfigError
from common.geometry import Pose, Scan
from deploy.profiles import load_deploy_config
from deploy.ros2 import conversions as ros
from deploy.ros2 import message
from tests.deploy.mapping.lidar import cloud_at, scan_at
from tests.deploy.mapping.test_frames import FREE, POINTS, Robot, base


def driven(spoil, *, cloud=False, overrides=()):
    """A robot that has driven with messages that were changed."""
    robot = Robot(*(POINTS if cloud else ()), *overrides)
    for step in range(20):
        robot.time = 1.0 + 0.1 * step
        robot.take("odometry", ros.odometry(robot.time, "map", "base_link", base(step)))
        if cloud:
            robot.take("points", spoil(ros.point_cloud(robot.time, "map", cloud_at(FREE, base(step)))))
        else:
            robot.take("scan", spoil(ros.laser_scan(robot.time, "base_link", scan_at(FREE, base(step)))))
    return robot


def backwards(scan):
    """A lidar that turns clockwise."""
    scan.ranges = scan.ranges[::-1].copy()
    scan.angle_min, scan.angle_max = scan.angle_max, scan.angle_min
    scan.angle_increment = -scan.angle_increment
    return scan


def from_zero(scan):
    """From 0 to 2 pi instead of from -pi to pi."""
    half = len(scan.ranges) // 2
    ranges = np.concatenate([scan.ranges[half:], scan.ranges[:half]])
    return ros.laser_scan(
        scan.header.stamp.sec + scan.header.stamp.nanosec * 1e-9,
        "base_link",
        Scan(ranges, 0.0, scan.angle_increment, scan.range_max, scan.range_min),
    )


def fields(**values):
    def spoil(sent):
        for name, value in values.items():
            setattr(sent, name, value)
        return sent

    return spoil


def far_as_numbers(scan):
    """Nothing met is told by a number beyond range_max, or by one for errors."""
    scan.ranges = np.where(np.isfinite(scan.ranges), scan.ranges, np.float32(65.533))
    return scan


SCANS = [
    backwards,
    from_zero,
    far_as_numbers,
    fields(time_increment=1.4e-4, scan_time=0.1),
    fields(intensities=np.full(720, 47.0, np.float32)),
    fields(range_max=float("inf")),
    fields(range_min=0.0),
    fields(angle_max=pi),
]


@pytest.mark.parametrize("spoil", SCANS, ids=range(len(SCANS)))
def test_scans(spoil):
    robot = driven(spoil)
    assert robot.walls_are_right()
    assert not any(robot.told) and robot.map.statistics.dropped == {}


def relaid(types, *, order="<", padding=3, rows=1, intensity=False):
    """Return what gives a cloud another layout."""

    def spoil(cloud):
        points = ros.points_from(cloud)
        points = points[: len(points) // rows * rows]
        codes = {"f4": 7, "f8": 8, "i2": 3}
        names = ["x", "y", "z", *(["intensity"] if intensity else [])]
        dtype = np.dtype(
            {
                "names": names,
                "formats": [order + one for one in types],
                "offsets": [8 + 9 * number for number in range(len(names))],
                "itemsize": 64,
            }
        )
        data = np.zeros(len(points), dtype)
        for number, name in enumerate(names[:3]):
            data[name] = points[:, number]
        raw = np.frombuffer(data.tobytes(), np.uint8).reshape(rows, -1)
        raw = np.pad(raw, ((0, 0), (0, padding)))
        return message(
            "sensor_msgs/msg/PointCloud2",
            header=cloud.header,
            height=rows,
            width=len(points) // rows,
            is_bigendian=order == ">",
            fields=[
                message("sensor_msgs/msg/PointField", name=name, offset=8 + 9 * number, datatype=codes[types[number]])
                for number, name in enumerate(names)
            ],
            point_step=64,
            row_step=raw.shape[1],
            data=raw.reshape(-1),
            is_dense=False,
        )

    return spoil


CLOUDS = [
    relaid(["f4"] * 3),
    relaid(["f8"] * 3, order=">"),
    relaid(["f4", "f8", "f4", "i2"], order=">", rows=4, intensity=True),
    relaid(["f4"] * 3, padding=0, rows=16),
    fields(is_dense=False),
]


@pytest.mark.parametrize("spoil", CLOUDS, ids=range(len(CLOUDS)))
def test_clouds(spoil):
    robot = driven(spoil, cloud=True)
    assert robot.walls_are_right()
    assert not any(robot.told) and robot.map.statistics.dropped == {}


def test_points_that_are_nan_in_a_cloud_that_calls_itself_dense():
    def spoil(cloud):
        points = ros.points_from(cloud).copy()
        points[::3] = np.nan
        return fields(is_dense=True)(ros.point_cloud(ros_time(cloud), "map", points))

    assert driven(spoil, cloud=True).walls_are_right()


def ros_time(sent):
    return sent.header.stamp.sec + sent.header.stamp.nanosec * 1e-9


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (fields(intensities=np.ones(7, np.float32)), "7 intensities"),
        (fields(angle_max=1.0), "angles of the scan contradict"),
        (fields(angle_min=-180.0, angle_max=180.0, angle_increment=0.5), "radians"),
    ],
)
def test_scans_that_contradict_themselves_are_named(spoil, words):
    assert any(words in told for told in driven(spoil).told)


def overlapping(cloud):
    cloud.fields = copy.deepcopy(cloud.fields)
    cloud.fields[1].offset = 2
    return cloud


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda cloud: fields(row_step=cloud.row_step + 12)(cloud), "bytes"),
        (lambda cloud: fields(width=cloud.width - 1)(cloud), "row_step|bytes"),
        (lambda cloud: fields(width=cloud.width // 2, row_step=cloud.row_step // 2 // 12 * 12)(cloud), "bytes, got"),
        (fields(height=0), "0 x"),
        (overlapping, "overlap"),
    ],
)
def test_clouds_that_contradict_themselves_are_named(spoil, words):
    robot = driven(spoil, cloud=True)
    assert any(re.search(words, told) for told in robot.told)


def test_an_offset_in_degrees_is_refused():
    with pytest.raises(ConfigError, match="radians"):
        load_deploy_config(None, ["sensing.sensor_offset=0.2,0,90"], {})


def mounted(roll, steps=8):
    """A robot whose lidar's frame is rolled by an angle."""
    robot = Robot()
    sent = ros.transform_message([ros.transform(0.0, "base_link", "optical", Pose(0.0, 0.0, 0.0))])
    sent.transforms[0].transform.rotation = message("geometry_msgs/msg/Quaternion", x=sin(roll / 2), w=cos(roll / 2))
    robot.take("static_transforms", sent)
    for step in range(steps):
        robot.time = 1.0 + 0.1 * step
        robot.take("odometry", ros.odometry(robot.time, "map", "base_link", base(step)))
        robot.take("scan", ros.laser_scan(robot.time, "optical", scan_at(FREE, base(step))))
    return robot


def test_a_scan_in_the_optical_frame_of_a_camera_is_refused_by_name():
    robot = mounted(-pi / 2)
    assert robot.map.statistics.dropped["scan not level"] and robot.map.occupancy() is None
    assert any("'optical'" in told and "90 degrees" in told for told in robot.told)
    assert any("tilted by 10 degrees" in told for told in mounted(pi / 18).told)
    assert mounted(0.01).map.statistics.problem == ""


@pytest.mark.parametrize("frame", ["map", "base_link"])
def test_a_cloud_in_millimetres_is_told(frame):
    robot = driven(lambda cloud: ros.point_cloud(ros_time(cloud), frame, ros.points_from(cloud) * 1000.0), cloud=True)
    assert robot.map.statistics.dropped == {"cloud too far": 20} and robot.map.occupancy() is None
    assert any("millimetres" in told for told in robot.told)


def test_a_cloud_of_which_no_point_is_low_enough_is_told():
    robot = driven(lambda cloud: ros.point_cloud(ros_time(cloud), "map", ros.points_from(cloud) + 5), cloud=True)
    assert robot.map.statistics.dropped == {"cloud too high": 20}
    assert any("sensing.sensor_height" in told for told in robot.told)


@pytest.mark.parametrize(
    ("parents", "words"),
    [
        ([("odom", "base_link")], "no frame 'map' but 'base_link', 'odom'"),
        ([("map", "odom"), ("odom", "base_footprint")], "no frame 'base_link' but"),
        ([("map", "odom"), ("wheels", "base_link")], "'base_link' up to 'wheels', and from 'map' up to 'map'"),
    ],
)
def test_what_lacks_in_tf_is_named(parents, words):
    robot = Robot("sensing.pose=tf")
    for step in range(30):
        robot.time = 1.0 + 0.1 * step
        for parent, child in parents:
            robot.tf(parent, child, base(step), static=False)
    assert words in robot.map.statistics.problem
    robot.tf("map", "odom", Pose(0.0, 0.0), static=False)


@pytest.mark.parametrize(
    ("parent", "static", "words"),
    [
        ("base_footprint", False, "'base_footprint' and 'odom'"),
        ("base_footprint", True, "'base_footprint' and 'odom'"),
        ("odom", True, "'odom' on both /tf and /tf_static"),
    ],
)
def test_a_frame_with_two_publishers_is_named(parent, static, words, caplog):
    robot = Robot("sensing.pose=tf")
    robot.tf("map", "odom", Pose(0.0, 0.0), static=False)
    for step in range(12):
        robot.time = 1.0 + 0.1 * step
        robot.tf("odom", "base_link", base(step), static=False)
        if not static or step % 5 == 0:
            robot.tf(parent, "base_link", Pose(0.0, 0.0), static=static)
    assert f"frame 'base_link' hangs by turns on {words}" in robot.map.statistics.problem
    assert sum("two publishers" in told for told in caplog.messages) == 1


def test_a_frame_that_moves_to_another_parent_for_good_is_none_with_two_publishers():
    robot = Robot("sensing.pose=tf")
    for step in range(60):
        robot.time = 1.0 + 0.1 * step
        robot.tf("odom" if step < 30 else "slam", "base_link", base(step), static=False)
    assert not any("two publishers" in told for told in robot.told)
