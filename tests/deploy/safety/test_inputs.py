"""What the watchdog takes as news of the robot's pose and of its clock."""

import numpy as np
import pytest

from common.geometry import Pose, Scan
from deploy.profiles import load_deploy_config
from deploy.ros2 import Received
from deploy.ros2.conversions import laser_scan, occupancy_grid, odometry, transform, transform_message
from deploy.ros2.messages import serialize
from deploy.safety.inputs import WatchdogInputs
from deploy.safety.rules import GateRules


def heard(fixed, moved):
    """Whether a message of /tf counts, after static transforms from parents to children."""
    config = load_deploy_config(None, ["sensing.pose=tf"], {}, "bare")
    rules = GateRules(config.safety, "scan", 0.0, drives=True)
    inputs = WatchdogInputs(config, rules, "1", lambda: None, lambda: None)
    received = Received(5.0, 0, 0)
    for frames, take in ((fixed, inputs._heard_static_transforms), (moved, inputs._heard_transforms)):
        take(transform_message([transform(1.0, parent, child, Pose(0.0, 0.0)) for parent, child in frames]), received)
    return rules.pose_time == 5.0


FOOTPRINT = [("base_footprint", "/base_link"), ("base_link", "laser")]


@pytest.mark.parametrize(
    ("fixed", "moved", "counts"),
    [
        ([], [("odom", "base_link")], True),
        ([], [("map", "odom")], False),
        ([], [("odom", "base_footprint")], False),
        (FOOTPRINT, [("/odom", "/base_footprint")], True),
        (FOOTPRINT, [("map", "odom")], False),
        (FOOTPRINT, [("base_link", "wheel")], False),
        ([("a", "base_link"), ("base_link", "a")], [("map", "odom")], False),
    ],
)
def test_only_what_moves_the_base_is_news_of_its_pose(fixed, moved, counts):
    assert heard(fixed, moved) == counts


def told(profile, *settings):
    config = load_deploy_config(None, list(settings), {}, profile)
    rules = GateRules(config.safety, config.sensing.source, 0.0, drives=True)
    return WatchdogInputs(config, rules, "1", lambda: None, lambda: None)


def test_velocities_are_stamped_by_the_clock_of_transforms_however_old_the_map_is():
    inputs = told("nav2")
    cells = np.zeros((4, 4), np.int8)
    kind = "nav_msgs/msg/OccupancyGrid"
    inputs._heard_sensor(serialize(occupancy_grid(10.0, "map", cells, 0.1), kind), Received(5.0, 0, 0))
    assert inputs.robot_time(5.0) == 0.0  # receivers take it for now
    links = [transform(2000.0, "map", "odom", Pose(0.0, 0.0)), transform(1000.0, "odom", "base_link", Pose(0.0, 0.0))]
    inputs._heard_transforms(transform_message(links), Received(6.0, 0, 0))
    inputs._heard_sensor(serialize(occupancy_grid(10.0, "map", cells, 0.1), kind), Received(6.5, 0, 0))
    assert inputs.robot_time(7.0) == 1001.0


def test_velocities_are_stamped_by_the_clock_of_the_odometry_and_not_by_that_of_a_lidar():
    inputs = told("bare")
    scan = laser_scan(77.0, "laser", Scan(np.ones(4, np.float32), 0.0, 0.1, 10.0))
    for stamp, expected in ((1000.0, 1001.0), (0.0, 0.0), (2.0, 3.0)):
        pose = odometry(stamp, "odom", "base_link", Pose(0.0, 0.0))
        inputs._heard_pose(serialize(pose, "nav_msgs/msg/Odometry"), Received(6.0, 0, 0))
        inputs._heard_sensor(serialize(scan, "sensor_msgs/msg/LaserScan"), Received(6.5, 0, 0))
        assert inputs.robot_time(7.0) == expected
