"""What a user is told, by the relay and by `hd-deploy topics`, of a robot whose topics are elsewhere or unheard."""

import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed: `make test-ros` runs these")

from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from sensor_msgs.msg import LaserScan
from typer.testing import CliRunner

from deploy.cli import app
from deploy.ros2 import message
from tests.common.bus.processes import eventually
from tests.deploy.relay.network import BEST_EFFORT, LATCHED, bridge_node, dds_node, robot, running_relay
from tests.deploy.relay.test_relay import grid

PATIENCE = 12.0
POSE = "geometry_msgs/msg/PoseStamped"


def told(relay, words, seconds=PATIENCE):
    return eventually(lambda: any(words in problem for problem in relay.status()["problems"]), seconds)


def test_a_robot_in_a_namespace_is_found_by_what_it_publishes(domain):
    config = robot(domain)
    with running_relay(config) as relay, dds_node("base", domain, "/robot1") as base:
        base.create_publisher(LaserScan, "scan", BEST_EFFORT)
        base.create_publisher(Odometry, "odom", 10)
        assert told(relay, "but for /robot1/scan: set topics.scan=/robot1/scan for relay and bridge")
        assert told(relay, "but for /robot1/odom: set topics.odometry=/robot1/odom for relay and bridge")
        where = ["--connect", config.ros.listen[0], "--set", f"ros.domain={domain}"]
        with bridge_node(config):
            seen = CliRunner().invoke(app, ["topics", *where]).stdout
        # The relay's own publishers on the other side are none of the robot's.
        words = " ".join(seen.split())
        assert "not published, but needed by the bridge: /scan, /odom" in words
        assert "published on /robot1/scan: --set topics.scan=/robot1/scan" in words
        assert "/robot1/odom: nav_msgs/msg/Odometry" in words


def test_a_domain_without_a_robot_is_named(domain):
    with running_relay(robot(domain)) as relay:
        assert told(relay, f"no other node in DDS domain {domain}: is the robot in another one")
        with dds_node("base", domain):
            assert eventually(lambda: not any("no other node" in one for one in relay.status()["problems"]))


def test_a_base_that_asks_for_a_deadline_is_named(domain):
    config = robot(domain)
    with running_relay(config) as relay, dds_node("base", domain) as base:
        base.create_subscription(Twist, "/cmd_vel", print, QoSProfile(depth=1, deadline=Duration(seconds=0.2)))
        assert told(relay, "/base receives nothing on /cmd_vel, because its subscription asks for a deadline of 0.2 s")


def test_a_map_that_was_published_once_is_not_missed(domain):
    with running_relay(robot(domain, profile="nav2")) as relay, dds_node("other", domain):
        with dds_node("map_server", domain) as server:
            server.create_publisher(OccupancyGrid, "/map", LATCHED).publish(grid())
            assert eventually(lambda: relay.status()["to_bridge"]["/map"]["messages"])
        assert not told(relay, "/map", 7.0)


def test_a_stack_that_drives_the_robot_may_publish_velocities(domain):
    with running_relay(robot(domain, profile="nav2")) as relay, dds_node("velocity_smoother", domain) as nav2:
        nav2.create_publisher(Twist, "/cmd_vel_smoothed", 10)
        assert told(relay, "no publisher in DDS for /map")
        assert not told(relay, "/velocity_smoother publishes on", 2.0)


def test_the_bridge_sees_whether_anybody_in_dds_hears_its_goals(domain):
    """nav2 is not there, comes, dies, and comes again."""
    config = robot(domain, profile="nav2")
    with running_relay(config), bridge_node(config) as bridge:
        goals = bridge.publisher("/goal_pose", POSE)
        assert not eventually(lambda: goals.heard, 1.5)
        for _ in range(2):
            with dds_node("bt_navigator", domain) as nav2:
                heard = []
                nav2.create_subscription(PoseStamped, "/goal_pose", heard.append, 10)
                assert eventually(lambda: goals.heard, 5.0)
                goals.publish(message(POSE))
                assert eventually(lambda heard=heard: heard, 5.0)
            assert eventually(lambda: not goals.heard, 5.0)
