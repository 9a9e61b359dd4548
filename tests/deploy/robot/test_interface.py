"""The simulated robot over a real bus: what its topics tell, and what it does when told."""

import json
import math
import socket
import threading
import time

import pytest

pytest.importorskip("pybullet", reason="PyBullet is not installed")

from common.geometry import Pose
from deploy.config import DrivingConfig
from deploy.driving import LocalPlanner
from deploy.profiles import load_deploy_config
from deploy.robot.cli import robot_config
from deploy.robot.interface import TRUTH_TOPIC
from deploy.robot.options import RobotOptions
from deploy.robot.process import run_robot
from deploy.robot.simulation import load_world
from deploy.ros2 import LATCHED, Node, message
from deploy.ros2.conversions import (
    grid_from,
    point_stamped,
    points_from,
    pose_from,
    scan_from,
    transforms_from,
    twist,
    twist_stamped,
)

WORLD = "generator:rooms?width=192&height=192&seed=5"


def free_endpoint():
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{found.getsockname()[1]}"


class Running:
    """A robot in a thread of its own, and a node that looks at it from outside."""

    def __init__(self, profile, overrides=(), **options):
        endpoint = free_endpoint()
        config = load_deploy_config(profile=profile, overrides=overrides)
        self.config = robot_config(config, [endpoint], None)
        self.stop = threading.Event()
        arguments = (RobotOptions(map=WORLD, **options), robot_config(config, None, [endpoint]), self.stop)
        self.thread = threading.Thread(target=run_robot, args=arguments, daemon=True)
        self.thread.start()
        self.node = Node(self.config.ros, "observer")
        self._truth = self.node.latest(TRUTH_TOPIC, "std_msgs/msg/String")

    def truth(self):
        return json.loads(wait(self._truth.get)[0].data)

    def until(self, condition, seconds=60.0):
        return wait(lambda: (truth := self.truth()) and condition(truth) and truth, seconds)

    def close(self):
        self.stop.set()
        self.thread.join(60.0)
        self.node.close()
        assert not self.thread.is_alive()


pytestmark = pytest.mark.timeout(300)


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    """Compile what makes worlds and what follows waypoints, before tests that run against the clock."""
    load_world(RobotOptions(map=WORLD))
    LocalPlanner(DrivingConfig())


@pytest.fixture
def run():
    made = []

    def start(profile="bare", overrides=(), **options):
        made.append(Running(profile, overrides, **options))
        return made[-1]

    yield start
    for running in made:
        running.close()


def wait(get, seconds=60.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        value = get()
        if value:
            return value
        time.sleep(0.01)
    raise AssertionError(f"nothing within {seconds} s")


def stamped(value):
    return value.header.stamp.sec + 1e-9 * value.header.stamp.nanosec


def test_bare_scan_odometry_transforms_and_clock_fit_together(run):
    robot = run("bare")
    node = robot.node
    scans = node.latest("/scan", "sensor_msgs/msg/LaserScan")
    odometry = node.latest("/odom", "nav_msgs/msg/Odometry")
    tf = node.latest("/tf", "tf2_msgs/msg/TFMessage")
    static = node.latest("/tf_static", "tf2_msgs/msg/TFMessage", LATCHED)
    clock = node.latest("/clock", "rosgraph_msgs/msg/Clock")
    scan = wait(scans.get)[0]
    assert scan.header.frame_id == "laser"
    ranges = scan_from(scan)
    assert len(ranges.ranges) == 720
    assert 0.0 < ranges.range_min < ranges.range_max == 20.0
    told = wait(odometry.get)[0]
    assert (told.header.frame_id, told.child_frame_id) == ("map", "base_link")
    _, pose, _ = pose_from(told)
    assert pose.distance_to((0.0, 0.0)) < 0.1
    chain = {(parent, child) for _, parent, child, *_ in transforms_from(wait(tf.get)[0])}
    assert chain == {("map", "odom"), ("odom", "base_link")}
    ((_, parent, child, (_, _, height), _),) = transforms_from(wait(static.get)[0])
    assert (parent, child) == ("base_link", "laser")
    assert height == pytest.approx(0.45, abs=0.01)
    now = wait(clock.get)[0].clock
    assert abs(now.sec + 1e-9 * now.nanosec - stamped(wait(scans.get)[0])) < 1.0
    assert abs(stamped(scan) - time.time()) < 30.0


@pytest.mark.parametrize("layout", ["rmw_zenoh", "ros2dds"])
def test_velocities_drive_it_and_without_them_it_stands_within_half_a_second_of_the_time_out(run, layout):
    robot = run("bare", [f"ros.layout={layout}"])
    velocity = robot.node.publisher("/cmd_vel", "geometry_msgs/msg/Twist")
    robot.truth()
    end = time.monotonic() + 1.5
    while time.monotonic() < end:
        velocity.publish(twist(0.0, 1.0))
        time.sleep(0.05)
    assert robot.truth()["turn_rate"] == pytest.approx(1.0, abs=0.1)
    silent = time.monotonic()
    robot.until(lambda truth: abs(truth["turn_rate"]) < 0.02, 5.0)
    assert 0.3 < time.monotonic() - silent < 2.5


def test_stamped_velocities_are_understood_and_what_is_not_finite_is_refused(run):
    robot = run("bare", ["driving.message=TwistStamped"])
    velocity = robot.node.publisher("/cmd_vel", "geometry_msgs/msg/TwistStamped")
    robot.truth()
    for _ in range(20):
        velocity.publish(twist_stamped(time.time(), "base_link", 0.0, -0.5))
        time.sleep(0.05)
    assert robot.truth()["yaw"] < -0.1
    velocity.publish(twist_stamped(time.time(), "base_link", math.nan, 0.0))
    robot.until(lambda truth: truth["refused_commands"] == 1, 10.0)


def test_cmu_clouds_are_registered_and_poses_are_told_at_the_stacks_height(run):
    robot = run("cmu", rays=180)
    clouds = robot.node.latest("/registered_scan", "sensor_msgs/msg/PointCloud2")
    odometry = robot.node.latest("/state_estimation", "nav_msgs/msg/Odometry")
    cloud = wait(clouds.get)[0]
    assert cloud.header.frame_id == "map"
    points = points_from(cloud)
    assert len(points) > 1000
    assert points[:, 2].min() == pytest.approx(0.0, abs=0.05)
    told = wait(odometry.get)[0]
    assert told.child_frame_id == "sensor"
    assert told.pose.pose.position.z == pytest.approx(0.75)


def test_nav2_map_is_latched_and_transforms_lead_to_the_truth(run):
    robot = run("nav2", ["mapping.resolution=0.2"], odometry_drift=0.05)
    robot.until(lambda truth: truth["time"] > 1.5)
    maps = robot.node.latest("/map", "nav_msgs/msg/OccupancyGrid", LATCHED)
    cells, resolution, (x, y, _) = grid_from(wait(maps.get)[0])
    assert resolution == pytest.approx(0.2)
    row, column = int(-y / 0.2), int(-x / 0.2)
    assert cells[row, column] == 0
    assert (cells == 100).any()
    assert (cells == -1).any()


def test_faster_than_real_time(run):
    robot = run("bare", speed_factor=4.0, rays=90)
    before = robot.truth()["time"]
    began = time.monotonic()
    after = robot.until(lambda truth: truth["time"] > before + 4.0)
    assert 1.3 < (after["time"] - before) / (time.monotonic() - began) < 6.0


def test_messages_of_sensors_come_late_by_the_latency(run):
    robot = run("bare", sensor_latency=0.4, rays=90)
    scans = robot.node.latest("/scan", "sensor_msgs/msg/LaserScan")
    wait(scans.get)
    late = []
    for _ in range(10):
        time.sleep(0.1)
        message_, received = scans.get()
        late.append(received.wall_time * 1e-9 - stamped(message_))
    assert 0.3 < min(late) < 2.0


def test_a_follower_drives_to_the_waypoint_and_honours_stop(run):
    robot = run("cmu", rays=180, layers=1)
    waypoint = robot.node.publisher("/way_point", "geometry_msgs/msg/PointStamped")
    stop = robot.node.publisher("/stop", "std_msgs/msg/Int8")
    goal = free_place(robot, 2.0)
    for _ in range(5):
        waypoint.publish(point_stamped(time.time(), "map", goal))
        time.sleep(0.1)
    robot.until(lambda truth: truth["speed"] > 0.2)
    for _ in range(3):
        stop.publish(message("std_msgs/msg/Int8", data=2))
        time.sleep(0.05)
    robot.until(lambda truth: abs(truth["speed"]) < 0.02 and abs(truth["turn_rate"]) < 0.05, 10.0)
    for _ in range(3):
        stop.publish(message("std_msgs/msg/Int8", data=0))
        time.sleep(0.05)
    there = robot.until(lambda truth: Pose(truth["x"], truth["y"]).distance_to(goal) < 0.35)
    assert there["collisions"] == 0


def free_place(robot, distance):
    """A place so far away in the direction in which the lidar sees most."""
    clouds = robot.node.latest("/registered_scan", "sensor_msgs/msg/PointCloud2")
    points = points_from(wait(clouds.get)[0])
    clear = []
    for step in range(24):
        angle = step * math.pi / 12
        along = points[:, 0] * math.cos(angle) + points[:, 1] * math.sin(angle)
        aside = abs(points[:, 1] * math.cos(angle) - points[:, 0] * math.sin(angle))
        clear.append((min(along[(aside < 0.6) & (along > 0)], default=9.0), angle))
    reach, angle = max(clear)
    assert reach > distance + 0.5
    return distance * math.cos(angle), distance * math.sin(angle)
