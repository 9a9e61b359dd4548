"""A lidar turns while the robot does: what it saw in one turn is placed beam by beam."""

from math import pi

import numpy as np
import pytest

from common.geometry import Pose, Scan
from common.mapping.raycast import cast_rays
from deploy.ros2 import conversions as ros
from deploy.ros2 import message
from tests.deploy.mapping.lidar import RESOLUTION, cloud_at
from tests.deploy.mapping.test_frames import FREE, Robot

PERIOD = 0.1
BEAMS = 360
CENTRE = (4.5, 5.0)
RATE = 1.5
"""Turn rate, rad/s: `driving.max_turn_rate` of a bridge that nobody configured."""
EMPTY = Scan(np.empty(0, np.float32), 0.0, 0.1, 12.0)


def turned(time: float) -> Pose:
    return Pose(*CENTRE, RATE * time)


def swept(time: float, period: float = PERIOD, direction: float = 1.0) -> np.ndarray:
    """Ranges of beams from -pi on, one after another, as the robot turns."""
    moments = time + np.arange(BEAMS) * period / BEAMS
    angles = RATE * moments + direction * (-pi + 2.0 * pi / BEAMS * np.arange(BEAMS))
    return cast_rays(FREE, RESOLUTION, 0.0, 0.0, *CENTRE, angles, 12.0)


def scan_of(time: float, period: float = PERIOD, direction: float = 1.0, increment: float | None = None):
    scan = Scan(swept(time, period, direction), direction * -pi, direction * 2.0 * pi / BEAMS, 12.0, 0.1)
    sent = ros.laser_scan(time, "base_link", scan, period)
    sent.time_increment = period / BEAMS if increment is None else increment
    return sent


def cloud_of(time: float, unit: float, kind: str, began: float):
    """A cloud in the lidar's frame whose points tell when they were measured."""
    points, times = [], []
    for number in range(40):
        share = number / 40
        pose = turned(time + share * PERIOD)
        seen = cloud_at(FREE, pose, frame="sensor", azimuths=720)
        at = np.arctan2(seen[:, 1], seen[:, 0]) + pi
        chosen = (at >= 2.0 * pi * share) & (at < 2.0 * pi * (share + 1 / 40))
        points.append(seen[chosen])
        times.append(np.full(int(chosen.sum()), (share * PERIOD + began) / unit))
    data = np.zeros(sum(map(len, points)), [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("t", "<" + kind)])
    for column, name in enumerate("xyz"):
        data[name] = np.concatenate(points)[:, column]
    data["t"] = np.concatenate(times)
    # Points without a return have a time, too.
    data["x"][::7] = np.nan
    number = {"f4": 7, "f8": 8, "u4": 6}
    return message(
        "sensor_msgs/msg/PointCloud2",
        header=message("std_msgs/msg/Header", stamp=ros.laser_scan(time, "", EMPTY).header.stamp, frame_id="lidar"),
        height=1,
        width=len(data),
        fields=[
            message(
                "sensor_msgs/msg/PointField", name=name, offset=data.dtype.fields[name][1], datatype=datatype, count=1
            )
            for name, datatype in (("x", 7), ("y", 7), ("z", 7), ("t", number[kind]))
        ],
        point_step=data.dtype.itemsize,
        row_step=data.dtype.itemsize * len(data),
        data=np.frombuffer(data.tobytes(), np.uint8),
        is_dense=True,
    )


def turn(robot: Robot, sense, *, steps: int = 20) -> Robot:
    """Turn in place, with odometry at 50 Hz and what is sensed at 10 Hz."""
    robot.tf("base_link", "lidar", Pose(0.0, 0.0))
    for step in range(5 * steps):
        robot.time = 1.0 + 0.02 * step
        robot.take("odometry", ros.odometry(robot.time, "map", "base_link", turned(robot.time)))
        if step % 5 == 0:
            sense(robot)
    return robot


def wrong(robot: Robot) -> tuple[int, int]:
    """Occupied cells without a wall within a cell of the room, and free ones inside of a wall."""
    states, resolution, origin = robot.map.occupancy()
    padded = np.pad(FREE, 3, constant_values=False)

    def neighbours(value):
        places = (np.argwhere(states == value)[:, ::-1] + 0.5) * resolution + np.array(origin)
        cells = np.clip(np.floor(places / RESOLUTION).astype(int), -1, np.array(FREE.shape)[::-1])
        return [padded[r + 2 : r + 5, c + 2 : c + 5] for c, r in cells]

    return sum(bool(near.all()) for near in neighbours(100)), sum(not near.any() for near in neighbours(0))


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_walls_stay_where_they_are_while_robot_and_lidar_turn(direction):
    robot = turn(
        Robot("mapping.resolution=0.1"),
        lambda robot: robot.take("scan", scan_of(robot.time, direction=direction)),
    )
    assert wrong(robot) == (0, 0)
    assert robot.map.statistics.dropped == {}


def test_without_deskewing_they_smear():
    robot = turn(
        Robot("mapping.resolution=0.1", "sensing.deskew=false"), lambda robot: robot.take("scan", scan_of(robot.time))
    )
    assert sum(wrong(robot)) > 50


def test_obstacles_of_the_local_planner_are_placed_beam_by_beam():
    robot = turn(Robot(), lambda robot: robot.take("scan", scan_of(robot.time)))
    points = robot.map.obstacles_near(turned(robot.time), 20.0)
    inside = [FREE[int(y // RESOLUTION), int(x // RESOLUTION)] for x, y in points - 1e-3 * (points - CENTRE)]
    depth = [FREE[int(y // RESOLUTION), int(x // RESOLUTION)] for x, y in points + 0.02 * (points - CENTRE)]
    assert np.mean(inside) > 0.9 and np.mean(depth) < 0.1


def test_a_scan_waits_for_the_pose_of_its_last_beam():
    robot = Robot()
    robot.take("odometry", ros.odometry(1.0, "map", "base_link", turned(1.0)))
    robot.take("scan", scan_of(1.0))
    assert robot.map.statistics.waiting == 1
    robot.time = 1.1
    robot.take("odometry", ros.odometry(1.1, "map", "base_link", turned(1.1)))
    assert robot.map.statistics.waiting == 0 and robot.map.statistics.integrated == 1


@pytest.mark.parametrize("increment", [0.1, -1e-4, float("nan")])
def test_a_time_increment_that_cannot_be_is_named(increment):
    robot = Robot()
    robot.take("odometry", ros.odometry(1.0, "map", "base_link", turned(1.0)))
    robot.take("scan", scan_of(1.0, increment=increment))
    assert any("time_increment" in told and "correct the driver" in told for told in robot.told)
    assert robot.map.statistics.integrated == 1


CLOUDS = [
    (1.0, "f4", 0.0),
    (1e-9, "u4", 0.0),
    (1e-6, "u4", 0.0),
    (1.0, "f4", -PERIOD),
]


@pytest.mark.parametrize(("unit", "kind", "began"), CLOUDS)
def test_clouds_are_placed_point_by_point(unit, kind, began):
    robot = turn(
        Robot(
            "mapping.resolution=0.1", "sensing.source=points", "topics.points=/points", "sensing.points_frame=sensor"
        ),
        lambda robot: robot.take("points", stamped(cloud_of(robot.time, unit, kind, began), robot.time - began)),
    )
    assert wrong(robot) == (0, 0)
    assert set(robot.map.statistics.dropped) <= {"no pose"}


def test_clouds_with_the_time_since_1970_are_placed_point_by_point():
    robot = turn(
        Robot(
            "mapping.resolution=0.1", "sensing.source=points", "topics.points=/points", "sensing.points_frame=sensor"
        ),
        lambda robot: robot.take("points", cloud_of(robot.time, 1.0, "f8", robot.time)),
    )
    assert wrong(robot) == (0, 0)


def stamped(cloud, time):
    cloud.header.stamp = ros.laser_scan(time, "", EMPTY).header.stamp
    return cloud
