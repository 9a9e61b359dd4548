"""Several lidars on one topic, each with its own frame: none of them hides what is wrong with another."""

from math import cos, pi, sin

import numpy as np
import pytest

from common.geometry import Pose, Scan
from deploy.bridge.inputs import Inputs
from deploy.mapping.robot_map import RobotMap
from deploy.profiles import load_deploy_config
from deploy.ros2 import Received
from deploy.ros2 import conversions as ros
from deploy.safety.health import FaultKind, HealthMonitor
from deploy.safety.sensor_watch import MAX_LIDARS
from tests.deploy.mapping.lidar import room, scan_at

FREE = room()
MOUNTS = {"front": Pose(0.2, 0.0, 0.0), "rear": Pose(-0.2, 0.0, pi)}


def base(time):
    return Pose(4.0 + 0.5 * time, 6.0, 0.3 * time)


def scan_of(frame, time):
    """Half a circle, as seen from a mount."""
    robot, mount = base(time), MOUNTS[frame]
    x = robot.x + mount.x * cos(robot.yaw) - mount.y * sin(robot.yaw)
    y = robot.y + mount.x * sin(robot.yaw) + mount.y * cos(robot.yaw)
    whole = scan_at(FREE, Pose(x, y, robot.yaw + mount.yaw))
    quarter = len(whole.ranges) // 4
    return Scan(whole.ranges[quarter : 3 * quarter + 1], -pi / 2, whole.angle_increment, whole.range_max, 0.1)


class Robot:
    """A bridge's inputs with two lidars on one topic."""

    def __init__(self):
        config = load_deploy_config(None, [], {}, "bare")
        self.map = RobotMap(config)
        self.health = HealthMonitor(config.safety)
        self.inputs = Inputs(config, self.map, self.health)
        self.time = 0.0
        mounts = [ros.transform(0.0, "base_link", frame, mount) for frame, mount in MOUNTS.items()]
        self.inputs.take_static_transforms(ros.transform_message(mounts), self._received())

    def drive(self, seconds, front=lambda scan: scan):
        """Drive on with what became of the front lidar's scans; None for one that is lost."""
        for _ in range(round(10 * seconds)):
            self.time += 0.1
            self.inputs.take_odometry(ros.odometry(self.time, "map", "base_link", base(self.time)), self._received())
            for frame in MOUNTS:
                scan = scan_of(frame, self.time)
                seen = front(scan) if frame == "front" else scan
                if seen is not None:
                    self.inputs.take_scan(ros.laser_scan(self.time, frame, seen), self._received())
            self.map.refresh()
            self.health.updated_map(self.time)

    def _received(self):
        return Received(self.time, round(self.time * 1e9), 0)


def test_obstacles_are_those_of_all_lidars():
    robot = Robot()
    robot.drive(1.0)
    pose = base(robot.time)
    points = robot.map.obstacles_near(pose, 20.0) - np.array(pose.position)
    ahead = points @ np.array([cos(pose.yaw), sin(pose.yaw)])
    assert (ahead > 0.5).sum() > 50 and (ahead < -0.5).sum() > 50
    assert robot.health.check(robot.time) == []


def test_what_a_lidar_saw_that_is_silent_for_long_is_no_obstacle():
    robot = Robot()
    robot.drive(1.0)
    robot.drive(3.0, front=lambda scan: None)
    points = robot.map.obstacles_near(base(robot.time), 20.0)
    assert len(points) == np.isfinite(scan_of("rear", robot.time).ranges).sum()


LOST = [
    (lambda scan: None, FaultKind.SENSOR_STALE),
    (lambda scan: scan_of("front", 1.0), FaultKind.SENSOR_FROZEN),
    (
        lambda scan: Scan(np.full_like(scan.ranges, np.nan), scan.angle_min, scan.angle_increment, 30.0, 0.1),
        FaultKind.SENSOR_BLIND,
    ),
]


@pytest.mark.parametrize(("front", "kind"), LOST, ids=["silent", "frozen", "blind"])
def test_a_lidar_that_is_lost_is_named_though_the_other_one_works(front, kind):
    robot = Robot()
    robot.drive(2.0)
    robot.drive(1.4, front)
    (fault,) = robot.health.check(robot.time)
    assert fault.kind is kind and "'front'" in fault.reason
    robot.drive(0.2)
    assert robot.health.check(robot.time) == []


def test_a_lidar_for_obstacles_alone_must_not_fall_silent_either():
    config = load_deploy_config(
        None, ["driving.enabled=true", "sensing.pose=odometry", "topics.scan=/scan"], {}, "nav2"
    )
    health = HealthMonitor(config.safety, sensor="grid")
    inputs = Inputs(config, RobotMap(config), health)
    health.heard_sensor(0.0)
    health.updated_map(0.0)
    for step in range(1, 30):
        now = 0.1 * step
        received = Received(now, step, 0)
        inputs.take_odometry(ros.odometry(now, "map", "base_link", base(now)), received)
        if step < 15:
            inputs.take_scan(ros.laser_scan(now, "base_link", scan_of("front", now)), received)
            assert health.check(now) == []
    (fault,) = health.check(now)
    assert fault.kind is FaultKind.SENSOR_STALE and "no scan for 1.5 s" in fault.reason


def test_a_frame_that_was_named_by_mistake_is_no_lidar():
    robot = Robot()
    robot.inputs.take_scan(ros.laser_scan(0.05, "laser", scan_of("rear", 0.0)), robot._received())
    robot.drive(2.0)
    assert robot.health.check(robot.time) == []


def test_frames_without_end_are_watched_together():
    robot = Robot()
    scan = scan_of("rear", 0.0)
    for number in range(3 * MAX_LIDARS):
        robot.inputs.take_scan(ros.laser_scan(0.1 * number, f"laser{number}", scan), robot._received())
    assert len(robot.inputs._sight) <= MAX_LIDARS + 1
