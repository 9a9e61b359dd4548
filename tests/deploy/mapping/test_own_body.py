"""A lidar that sees parts of its own robot: they are no obstacles, wherever they are within the outline."""

from math import pi

import numpy as np
import pytest

from common.geometry import Pose, Scan
from deploy.config import DrivingConfig
from deploy.driving import LocalPlanner
from deploy.mapping.own_body import OwnBody
from deploy.ros2 import conversions as ros
from tests.deploy.mapping.lidar import cloud_at, scan_at
from tests.deploy.mapping.test_frames import FREE, POINTS, Robot, composed

HERE = Pose(4.0, 6.0, 0.2)
ROUND = ("driving.robot_radius=0.45",)
# A lidar at the front of a robot of 1.2 m by 0.6 m, and a rack at its rear that the lidar sees 0.8 m away.
LONG = ("driving.footprint=[[0.6,0.3],[-0.6,0.3],[-0.6,-0.3],[0.6,-0.3]]",)
SEEN = [
    (ROUND, (0.0, 0.0, 0.0), 0.4, (pi / 2, -pi / 2, pi)),
    (LONG, (0.3, 0.0, 0.0), 0.8, (pi,)),
    (LONG, (0.3, 0.0, pi), 0.8, (0.0,)),
]


def with_body(scan: Scan, distance: float, directions, width: float = 0.3) -> Scan:
    """The scan of a lidar that sees parts of the robot at a distance, in some directions."""
    angles = scan.angle_min + np.arange(len(scan.ranges)) * scan.angle_increment
    ranges = scan.ranges.copy()
    for direction in directions:
        own = np.abs((angles - direction + pi) % (2.0 * pi) - pi) < width / 2.0
        ranges[own] = np.minimum(ranges[own], distance)
    return Scan(ranges, scan.angle_min, scan.angle_increment, scan.range_max, scan.range_min)


def sensed(overrides, mount, distance, directions, *, cloud: bool = False, steps: int = 40) -> Robot:
    """A robot that has driven slowly, and sees itself."""
    robot = Robot("mapping.resolution=0.1", *(POINTS if cloud else ()), *overrides)
    robot.tf("base_link", "lidar", Pose(*mount))
    for step in range(steps):
        robot.time = 1.0 + 0.1 * step
        base = Pose(HERE.x + 0.01 * step, HERE.y, HERE.yaw)
        robot.take("odometry", ros.odometry(robot.time, "map", "base_link", base))
        lidar = composed(base, mount)
        if not cloud:
            seen = with_body(scan_at(FREE, lidar), distance, directions)
            robot.take("scan", ros.laser_scan(robot.time, "lidar", seen))
            continue
        points = cloud_at(FREE, lidar, frame="sensor")
        mast = [(distance * np.cos(a), distance * np.sin(a), z) for a in directions for z in np.linspace(-0.3, 0.5, 50)]
        robot.take("points", ros.point_cloud(robot.time, "lidar", np.concatenate([points, mast]).astype(np.float32)))
    return robot


@pytest.mark.parametrize("cloud", [False, True])
@pytest.mark.parametrize(("overrides", "mount", "distance", "directions"), SEEN)
def test_a_robot_that_sees_itself_drives(overrides, mount, distance, directions, cloud):
    robot = sensed(overrides, mount, distance, directions, cloud=cloud)
    pose = robot.map.pose
    assert len(robot.map.obstacles_near(pose, 1.0)) == 0
    states, resolution, origin = robot.map.occupancy()
    places = (np.argwhere(states == 100)[:, ::-1] + 0.5) * resolution + np.array(origin)
    assert np.hypot(*(places - pose.position).T).min() > 1.0, "no trail of itself"
    command = LocalPlanner(robot.config.driving).command(
        pose, (0.0, 0.0), [(pose.x + 2.0, pose.y)], robot.map.obstacles_near(pose, 4.0), 0.05
    )
    assert not command.blocked


def test_what_stands_beside_the_robot_is_an_obstacle():
    robot = sensed(LONG, (0.3, 0.0, 0.0), 0.5, (pi / 2,))
    assert len(robot.map.obstacles_near(robot.map.pose, 1.0)) > 20


def test_a_part_outside_of_the_outline_is_named_with_what_to_do():
    robot = sensed(("driving.robot_radius=0.4",), (0.0, 0.0, 0.0), 0.42, (pi / 2, -pi / 2, 0.0, pi))
    planner, pose = LocalPlanner(robot.config.driving), robot.map.pose
    for _ in range(200):
        command = planner.command(pose, (0.0, 0.0), [(pose.x + 2.0, pose.y)], robot.map.obstacles_near(pose, 4.0), 0.05)
    assert command.blocked
    assert "0.42 m" in command.reason and "driving.robot_radius" in command.reason


def test_the_outline_is_a_circle_or_a_polygon():
    places = np.array([(0.24, 0.0), (0.0, -0.26), (0.5, 0.29), (0.5, 0.31), (-0.7, 0.0), (np.nan, 0.0)])
    assert OwnBody(DrivingConfig()).covers(places).tolist() == [True, False, False, False, False, False]
    long = DrivingConfig(footprint=((0.6, 0.3), (-0.6, 0.3), (-0.6, -0.3), (0.6, -0.3)))
    assert OwnBody(long).covers(places).tolist() == [True, True, True, False, False, False]


def test_an_octomap_has_no_trail_of_the_robot():
    pytest.importorskip("pyoctomap")
    robot = sensed((*ROUND, "sensing.octomap=true"), (0.0, 0.0, 0.0), 0.4, (pi,), cloud=True, steps=10)
    states, resolution, origin = robot.map.occupancy()
    places = (np.argwhere(states == 100)[:, ::-1] + 0.5) * resolution + np.array(origin)
    assert np.hypot(*(places - robot.map.pose.position).T).min() > 1.0
