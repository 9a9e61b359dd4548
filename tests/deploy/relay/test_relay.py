"""Between real ROS 2 and the bridge's Zenoh: what goes through, and what a user is told when something cannot."""

import logging
import time

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed: `make test-ros` runs these")

from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import LaserScan, PointCloud2, PointField
from std_msgs.msg import Bool, String

from common.geometry import Pose
from deploy.relay.made_types import made_class
from deploy.relay.relay import Relay
from deploy.ros2 import LATCHED as OUR_LATCHED
from deploy.ros2 import SENSOR, STATIC, RosError, conversions, message
from deploy.ros2.messages import serialize
from tests.common.bus.processes import eventually
from tests.deploy.relay.network import (
    BEST_EFFORT,
    LATCHED,
    bridge_node,
    dds_node,
    repeat,
    robot,
    running_relay,
)  # fmt: skip

TWIST = "geometry_msgs/msg/Twist"


def test_messages_go_both_ways(domain):
    config = robot(domain)
    with running_relay(config) as relay, bridge_node(config) as bridge, dds_node("base", domain) as base:
        scans, commands = [], []
        bridge.subscribe("/scan", "sensor_msgs/msg/LaserScan", lambda scan, how: scans.append(scan), SENSOR)
        velocity = bridge.publisher("/cmd_vel", TWIST)
        base.create_subscription(Twist, "/cmd_vel", commands.append, 10)
        lidar = base.create_publisher(LaserScan, "/scan", BEST_EFFORT)
        scan = LaserScan(angle_increment=0.5, range_max=10.0, ranges=[1.0, 2.5, float("inf")])
        scan.header.frame_id = "laser"
        assert repeat(lambda: lidar.publish(scan), lambda: scans)
        assert scans[0].header.frame_id == "laser"
        assert scans[0].ranges.tolist() == [1.0, 2.5, np.inf]
        assert repeat(lambda: velocity.publish(conversions.twist(0.5, -0.25)), lambda: commands)
        assert (commands[0].linear.x, commands[0].angular.z) == (0.5, -0.25)
        status = relay.status()
        assert status["to_bridge"]["/scan"]["messages"] >= len(scans)
        assert status["to_robot"]["/cmd_vel"]["bytes"] >= 52 * len(commands)
        assert status["lost"] == 0
        assert "/scan" in relay.counters()


def test_nothing_comes_back(domain):
    config = robot(domain)
    with running_relay(config) as relay, bridge_node(config) as bridge, dds_node("base", domain) as base:
        heard_here, heard_there = [], []
        bridge.subscribe("/cmd_vel", TWIST, lambda command, how: heard_here.append(command))
        base.create_subscription(String, "/hd/command", heard_there.append, 10)
        velocity = bridge.publisher("/cmd_vel", TWIST)
        base.create_subscription(Twist, "/cmd_vel", heard_there.append, 10)
        assert repeat(lambda: velocity.publish(conversions.twist(0.0, 0.0)), lambda: heard_there)
        time.sleep(0.3)
        heard_here.clear(), heard_there.clear()
        before = relay.status()["to_robot"]["/cmd_vel"]["messages"]
        velocity.publish(conversions.twist(0.0, 0.0))
        assert eventually(lambda: heard_there)
        assert not eventually(lambda: len(heard_there) + len(heard_here) > 2, 0.5)
        assert relay.status()["to_robot"]["/cmd_vel"]["messages"] == before + 1


def test_a_cloud_of_half_a_megabyte_comes_whole(domain):
    config = robot(domain, profile="cmu")
    with running_relay(config), bridge_node(config) as bridge, dds_node("base", domain) as base:
        clouds = []
        bridge.subscribe("/registered_scan", "sensor_msgs/msg/PointCloud2", lambda cloud, how: clouds.append(cloud))
        points = np.random.default_rng(1).uniform(-20.0, 20.0, (30_000, 4)).astype(np.float32)
        cloud = PointCloud2(height=1, width=len(points), point_step=16, row_step=16 * len(points), is_dense=True)
        cloud.fields = [
            PointField(name=name, offset=4 * number, datatype=PointField.FLOAT32, count=1)
            for number, name in enumerate(("x", "y", "z", "intensity"))
        ]
        cloud.data = points.tobytes()
        lidar = base.create_publisher(PointCloud2, "/registered_scan", 5)
        assert repeat(lambda: lidar.publish(cloud), lambda: clouds)
        assert np.array_equal(conversions.points_from(clouds[0]), points)


def test_transforms_come_though_no_package_defines_their_type(domain):
    config = robot(domain, profile="nav2")
    kind = "tf2_msgs/msg/TFMessage"
    with running_relay(config), bridge_node(config) as bridge, dds_node("base", domain) as base:
        found = []
        bridge.subscribe("/tf_static", kind, lambda tree, how: found.extend(conversions.transforms_from(tree)), STATIC)
        broadcaster = base.create_publisher(made_class(kind, "kilted"), "/tf_static", LATCHED)
        mount = conversions.transform(1.0, "base_link", "laser", Pose(0.25, 0.0, 0.0), 0.5)
        broadcaster.publish(serialize(conversions.transform_message([mount]), kind))
        assert eventually(lambda: found)
        assert found[0][1:4] == ("base_link", "laser", (0.25, 0.0, 0.5))


def grid() -> OccupancyGrid:
    found = OccupancyGrid(data=[0, 100, -1, 0])
    found.info.width = found.info.height = 2
    found.info.resolution = 0.5
    return found


@pytest.mark.parametrize("latched", [True, False], ids=["latched", "volatile"])
def test_a_map_comes_whatever_its_publisher_offers(domain, latched):
    config = robot(domain, profile="nav2")
    with dds_node("slam", domain) as slam:
        publisher = slam.create_publisher(OccupancyGrid, "/map", LATCHED if latched else 1)
        publisher.publish(grid())
        with running_relay(config), bridge_node(config) as bridge:
            maps = []
            bridge.subscribe("/map", "nav_msgs/msg/OccupancyGrid", lambda found, how: maps.append(found), OUR_LATCHED)
            if latched:
                # It was published once, before relay and bridge were there.
                assert eventually(lambda: maps)
            else:
                assert repeat(lambda: publisher.publish(grid()), lambda: maps)
            assert maps[0].data.tolist() == [0, 100, -1, 0]
        # A bridge that is started anew gets it from a relay that has it; see the next test for relays started anew.


def test_late_comers_on_both_sides_get_what_is_latched(domain):
    config = robot(domain, profile="nav2")
    with running_relay(config), dds_node("slam", domain) as slam:
        slam.create_publisher(OccupancyGrid, "/map", LATCHED).publish(grid())
        maps, beliefs = [], []
        for _ in range(2):
            # The bridge goes and comes again, and the map is not published again.
            with bridge_node(config) as bridge:
                maps.clear()
                bridge.subscribe("/map", "nav_msgs/msg/OccupancyGrid", lambda one, how: maps.append(one), OUR_LATCHED)
                assert eventually(lambda: maps)
                belief = bridge.publisher("/hd/belief", "nav_msgs/msg/OccupancyGrid", OUR_LATCHED)
                belief.publish(conversions.occupancy_grid(1.0, "map", np.zeros((2, 3), np.int8), 0.1))
                with dds_node("rviz", domain) as rviz:
                    beliefs.clear()
                    rviz.create_subscription(OccupancyGrid, "/hd/belief", beliefs.append, LATCHED)
                    assert eventually(lambda: beliefs)
                    assert (beliefs[0].info.width, beliefs[0].info.height) == (3, 2)


def test_best_effort_odometry_is_heard(domain, caplog):
    config = robot(domain)
    with running_relay(config), bridge_node(config) as bridge, dds_node("base", domain) as base:
        heard = []
        bridge.subscribe("/odom", "nav_msgs/msg/Odometry", lambda odometry, how: heard.append(odometry))
        publisher = base.create_publisher(Odometry, "/odom", BEST_EFFORT)
        assert repeat(lambda: publisher.publish(Odometry()), lambda: heard)
        assert "/odom: a publisher is best effort" in caplog.text


def test_who_asks_for_more_than_is_offered_is_named(domain, caplog):
    config = robot(domain)
    with running_relay(config), dds_node("base", domain) as base:
        base.create_subscription(Twist, "/cmd_vel", lambda command: None, LATCHED)
        assert eventually(lambda: "/cmd_vel: a subscription receives nothing" in caplog.text)


def test_names_below_a_namespace(domain):
    config = robot(domain, "ros.namespace=robot1", "topics.scan=front/scan", "topics.velocity=cmd_vel")
    with (
        running_relay(config) as relay,
        bridge_node(config) as bridge,
        dds_node("base", domain, "/robot1") as base,
    ):
        assert relay.status()["dds_node"] == "/robot1/hd_bridge"
        scans, commands = [], []
        bridge.subscribe("front/scan", "sensor_msgs/msg/LaserScan", lambda scan, how: scans.append(scan), SENSOR)
        lidar = base.create_publisher(LaserScan, "front/scan", BEST_EFFORT)
        base.create_subscription(Twist, "cmd_vel", commands.append, 10)
        velocity = bridge.publisher("cmd_vel", TWIST)
        assert repeat(lambda: lidar.publish(LaserScan()), lambda: scans)
        assert repeat(lambda: velocity.publish(conversions.twist(0.5, 0.0)), lambda: commands)


def test_two_robots_in_one_domain_hear_their_own(domain):
    names = "topics.scan=scan", "topics.velocity=cmd_vel", "topics.odometry=odom", "topics.command=command"
    configs = [robot(domain, f"ros.namespace=robot{number}", *names) for number in (1, 2)]
    with running_relay(configs[0]), running_relay(configs[1]), dds_node("operator", domain) as operator:
        for number, config in enumerate(configs, 1):
            other = configs[2 - number]
            with bridge_node(config) as mine, bridge_node(other) as theirs:
                own, others, moved = [], [], []
                mine.subscribe("command", "std_msgs/msg/String", lambda text, how, own=own: own.append(text.data))
                theirs.subscribe("command", "std_msgs/msg/String", lambda text, how, o=others: o.append(text.data))
                publisher = operator.create_publisher(String, f"/robot{number}/command", 10)
                assert repeat(lambda publisher=publisher: publisher.publish(String(data="pause")), lambda own=own: own)
                operator.create_subscription(Twist, f"/robot{number}/cmd_vel", moved.append, 10)
                velocity = mine.publisher("cmd_vel", TWIST)
                assert repeat(
                    lambda velocity=velocity: velocity.publish(conversions.twist(0.1, 0.0)), lambda moved=moved: moved
                )
                assert set(own) == {"pause"}
                assert not others


def test_a_second_relay_does_not_start(domain):
    with running_relay(robot(domain)), pytest.raises(RosError, match="already has a node /hd_bridge"):
        Relay(robot(domain))


def test_a_second_relay_of_a_robot_does_not_start_from_another_domain(domain):
    config = robot(domain)
    with running_relay(config):
        endpoint = config.ros.listen[0]
        other = robot(domain % 100 + 1, "ros.listen=", f"ros.connect={endpoint}")
        with pytest.raises(RosError, match="a relay for robot 'robot' is already running"):
            Relay(other)


def test_a_topic_that_would_go_both_ways_is_refused(domain):
    with pytest.raises(RosError, match=r"/goal_pose would be relayed in both directions"):
        Relay(robot(domain, "topics.goal_pose=/goal_pose", profile="nav2"))


def test_wrong_types_and_other_sources_of_velocities_are_named(domain, caplog):
    config = robot(domain)
    with (
        running_relay(config) as relay,
        dds_node("base", domain) as base,
        dds_node("teleop", domain) as teleop,
    ):
        base.create_subscription(TwistStamped, "/cmd_vel", lambda command: None, 10)
        base.create_publisher(PoseStamped, "/odom", 10)
        teleop.create_publisher(Twist, "/cmd_vel", 10)
        wanted = [
            "set driving.message=TwistStamped",
            "geometry_msgs/msg/PoseStamped on /odom",
            "/teleop publishes on /cmd_vel",
        ]
        assert eventually(lambda: all(any(each in one for one in relay.status()["problems"]) for each in wanted))
        assert all(each in caplog.text for each in wanted)


def test_what_the_bridge_needs_and_nobody_publishes_is_named(domain, caplog):
    caplog.set_level(logging.WARNING)
    with running_relay(robot(domain)), dds_node("base", domain):
        assert eventually(lambda: "no publisher in DDS for /scan" in caplog.text, 10.0)


def test_anybody_in_dds_stops_the_robot(domain):
    config = robot(domain)
    with running_relay(config), bridge_node(config) as bridge, dds_node("button", domain) as button:
        heard = []
        bridge.subscribe("/hd/emergency_stop", "std_msgs/msg/Bool", lambda stop, how: heard.append(stop.data))
        publisher = button.create_publisher(Bool, "/hd/emergency_stop", BEST_EFFORT)
        assert repeat(lambda: publisher.publish(Bool(data=True)), lambda: heard)
        assert heard[0] is True


def test_the_relay_stops_a_robot_whose_velocities_cease(domain):
    config = robot(domain)
    with running_relay(config) as relay, dds_node("base", domain) as base:
        commands = []
        base.create_subscription(Twist, "/cmd_vel", lambda command: commands.append(command.linear.x), 10)
        with bridge_node(config) as bridge:
            velocity = bridge.publisher("/cmd_vel", TWIST)
            assert repeat(lambda: velocity.publish(conversions.twist(0.5, 0.0)), lambda: commands)
            velocity.publish(conversions.twist(0.5, 0.0))
        # The bridge and its watchdog are gone without a word.
        assert eventually(lambda: commands[-1] == 0.0, 2.0)
        assert relay.status()["stopping"]


def test_a_relay_that_ends_stops_the_robot(domain):
    config = robot(domain)
    with dds_node("base", domain) as base:
        commands = []
        base.create_subscription(Twist, "/cmd_vel", lambda command: commands.append(command.linear.x), 10)
        with running_relay(config), bridge_node(config) as bridge:
            velocity = bridge.publisher("/cmd_vel", TWIST)
            assert repeat(lambda: velocity.publish(conversions.twist(0.5, 0.0)), lambda: commands)
            velocity.publish(conversions.twist(0.5, 0.0))
            assert eventually(lambda: commands[-1] == 0.5)
        assert eventually(lambda: commands[-1] == 0.0, 2.0)


def test_messages_go_on_when_the_bridges_network_was_away(domain):
    config = robot(domain)
    with dds_node("base", domain) as base:
        lidar = base.create_publisher(LaserScan, "/scan", BEST_EFFORT)
        scans = []
        with bridge_node(config) as bridge:
            bridge.subscribe("/scan", "sensor_msgs/msg/LaserScan", lambda scan, how: scans.append(scan), SENSOR)
            for _ in range(2):
                # The relay is the router; it comes, goes and comes again, and the bridge stays.
                scans.clear()
                with running_relay(config):
                    assert repeat(lambda: lidar.publish(LaserScan()), lambda: scans)


def test_our_own_messages_are_read_by_real_nodes(domain):
    config = robot(domain)
    with running_relay(config), bridge_node(config) as bridge, dds_node("operator", domain) as operator:
        heard = []
        operator.create_subscription(String, "/hd/status", lambda text: heard.append(text.data), 10)
        status = bridge.publisher("/hd/status", "std_msgs/msg/String")
        assert repeat(lambda: status.publish(message("std_msgs/msg/String", data="läuft")), lambda: heard)
        assert heard[0] == "läuft"
