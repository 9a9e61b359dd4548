import threading
import time
from contextlib import ExitStack

import numpy as np
import pytest

from common.geometry import Pose, Scan
from deploy.network_config import RosConfig
from deploy.ros2 import LATCHED, RELIABLE, SENSOR, STATIC, Node, QoS, RosError, message
from deploy.ros2.conversions import (
    grid_from,
    laser_scan,
    occupancy_grid,
    odometry,
    pose_from,
    twist,
    velocity_from,
)
from tests.common.bus.processes import eventually, free_port
from tests.deploy.ros2.network import rmw_router, ros

TWIST = "geometry_msgs/msg/Twist"
SCAN = "sensor_msgs/msg/LaserScan"
GRID = "nav_msgs/msg/OccupancyGrid"
LAYOUTS = pytest.mark.parametrize("layout", ["rmw_zenoh", "ros2dds"])


def text(words):
    return message("std_msgs/msg/String", data=words)


def repeat(publisher, value, until, timeout=15.0) -> bool:
    """Publish until a condition holds: discovery takes a moment."""

    def again():
        publisher.publish(value)
        return until()

    return eventually(again, timeout)


@LAYOUTS
def test_messages_go_between_nodes(endpoint, layout):
    with Node(ros(endpoint, layout=layout), "driver") as driver, Node(ros(endpoint, layout=layout), "base") as base:
        got = []
        base.subscribe("/cmd_vel", TWIST, lambda command, how: got.append((velocity_from(command), how)))
        velocity = driver.publisher("/cmd_vel", TWIST)
        assert repeat(velocity, twist(0.5, -0.25), lambda: got)
        command, how = got[0]
        assert command == (0.5, -0.25)
        assert 0.0 <= time.monotonic() - how.time < 10.0
        assert how.size == 52
        if layout == "rmw_zenoh":
            assert how.sequence >= 1
            assert 0 <= how.wall_time - how.source_time < 10e9
            assert len(how.publisher) == 16
        else:
            assert (how.sequence, how.source_time, how.publisher) == (None, None, None)


@LAYOUTS
def test_late_subscribers_get_the_latched_map(endpoint, layout):
    cells = np.arange(-1, 5, dtype=np.int8).reshape(2, 3)
    with Node(ros(endpoint, layout=layout), "slam") as slam:
        maps = slam.publisher("/map", GRID, LATCHED)
        maps.publish(occupancy_grid(1.0, "map", cells - 1, 0.1))
        maps.publish(occupancy_grid(2.0, "map", cells, 0.1))
        with Node(ros(endpoint, layout=layout), "late") as late:
            newest = late.latest("/map", GRID, LATCHED)
            assert eventually(lambda: newest.get() is not None)
            time.sleep(0.2)
            grid, _ = newest.get()
            assert grid.header.stamp.sec == 2, "the last one, not one before"
            assert np.array_equal(grid_from(grid)[0], cells)


def test_latched_subscribers_find_publishers_that_come_later(endpoint):
    with Node(ros(endpoint), "early") as early:
        newest = early.latest("/map", GRID, LATCHED)
        for stamp in (1.0, 2.0):
            with Node(ros(endpoint), "slam") as slam:
                slam.publisher("/map", GRID, LATCHED).publish(occupancy_grid(stamp, "map", np.zeros((2, 2)), 0.1))
                assert eventually(lambda: newest.get() and newest.get()[0].header.stamp.sec == stamp)  # noqa: B023


def test_latched_subscribers_take_volatile_publishers_too(endpoint):
    with Node(ros(endpoint), "early") as early, Node(ros(endpoint), "slam") as slam:
        newest = early.latest("/map2", GRID, LATCHED)
        maps = slam.publisher("/map2", GRID, RELIABLE)
        assert repeat(maps, occupancy_grid(1.0, "map", np.zeros((2, 2)), 0.1), newest.get)


def test_static_transforms_of_several_broadcasters_all_arrive(endpoint):
    kind = "tf2_msgs/msg/TFMessage"
    with Node(ros(endpoint), "one") as one, Node(ros(endpoint), "two") as two, Node(ros(endpoint), "three") as three:
        for number, node in enumerate((one, two)):
            link = message("geometry_msgs/msg/TransformStamped", child_frame_id=f"link{number}")
            node.publisher("/tf_static", kind, LATCHED).publish(message(kind, transforms=[link]))
        got = set()
        three.subscribe("/tf_static", kind, lambda tf, _: got.add(tf.transforms[0].child_frame_id), STATIC)
        assert eventually(lambda: got == {"link0", "link1"})


def test_volatile_messages_are_not_kept(endpoint):
    with Node(ros(endpoint), "talker") as talker, Node(ros(endpoint), "listener") as listener:
        chatter = talker.publisher("/chatter", "std_msgs/msg/String")
        chatter.publish(text("before"))
        newest = listener.latest("/chatter", "std_msgs/msg/String")
        assert newest.get() is None
        assert newest.age() == float("inf")
        assert repeat(chatter, text("after"), newest.get)
        assert newest.get()[0].data == "after"
        assert newest.age() < 10.0


def test_nodes_start_before_their_router():
    port = free_port()
    config = ros(f"tcp/127.0.0.1:{port}")
    with Node(config, "early") as early, Node(config, "also") as also:
        newest = early.latest("/chatter", "std_msgs/msg/String")
        chatter = also.publisher("/chatter", "std_msgs/msg/String")
        chatter.publish(text("nobody there"))
        with rmw_router(port):
            assert repeat(chatter, text("now"), newest.get)


def test_a_node_can_be_the_router():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with (
        Node(RosConfig(listen=(endpoint,), connect=()), "bridge") as bridge,
        Node(ros(endpoint), "robot") as robot,
        Node(ros(endpoint, mode="client"), "laptop") as laptop,
    ):
        at_bridge = bridge.latest("/chatter", "std_msgs/msg/String")
        at_laptop = laptop.latest("/chatter", "std_msgs/msg/String")
        chatter = robot.publisher("/chatter", "std_msgs/msg/String")
        assert repeat(chatter, text("hello"), lambda: at_bridge.get() and at_laptop.get())


def test_clients_talk_through_a_router_that_forwards_no_peers(endpoint):
    with Node(ros(endpoint, mode="client"), "laptop") as laptop, Node(ros(endpoint), "robot") as robot:
        newest = laptop.latest("/chatter", "std_msgs/msg/String")
        assert repeat(robot.publisher("/chatter", "std_msgs/msg/String"), text("hello"), newest.get)


def test_clients_wait_for_their_router():
    port = free_port()
    nodes = []
    thread = threading.Thread(target=lambda: nodes.append(Node(ros(f"tcp/127.0.0.1:{port}", mode="client"), "late")))
    thread.start()
    time.sleep(0.3)
    assert not nodes
    with rmw_router(port):
        thread.join(20.0)
        assert nodes
        nodes[0].close()


def test_clients_come_back_when_their_router_does():
    port = free_port()
    config = ros(f"tcp/127.0.0.1:{port}", mode="client")
    with ExitStack() as nodes:
        with rmw_router(port):
            robot = nodes.enter_context(Node(config, "robot"))
            laptop = nodes.enter_context(Node(config, "laptop"))
            newest = laptop.latest("/chatter", "std_msgs/msg/String")
            chatter = robot.publisher("/chatter", "std_msgs/msg/String")
            robot.publisher("/map", GRID, LATCHED).publish(occupancy_grid(7.0, "map", np.zeros((2, 2)), 0.1))
            assert repeat(chatter, text("before"), newest.get)
        chatter.publish(text("lost"))
        with rmw_router(port):
            assert repeat(chatter, text("after"), lambda: newest.get()[0].data == "after")
            late = laptop.latest("/map", GRID, LATCHED)
            assert eventually(lambda: late.get() and late.get()[0].header.stamp.sec == 7)


def test_domains_and_types_are_kept_apart(endpoint):
    with Node(ros(endpoint, domain=5), "a") as a, Node(ros(endpoint), "b") as b:
        other_domain = a.latest("/chatter", "std_msgs/msg/String")
        other_type = b.latest("/chatter", "std_msgs/msg/Bool")
        right = b.latest("/chatter", "std_msgs/msg/String")
        chatter = b.publisher("/chatter", "std_msgs/msg/String")
        assert repeat(chatter, text("hello"), right.get)
        time.sleep(0.2)
        assert other_domain.get() is None
        assert other_type.get() is None


def test_namespaces_and_remapping(endpoint):
    remap = {"/scan": "/robot1/lidar"}
    with Node(ros(endpoint, namespace="robot1"), "base") as base, Node(ros(endpoint), "bridge", remap) as bridge:
        newest = bridge.latest("/scan", SCAN, SENSOR)
        assert newest.topic == "/robot1/lidar"
        lidar = base.publisher("lidar", SCAN, SENSOR)
        assert lidar.topic == "/robot1/lidar"
        scan = laser_scan(1.0, "laser", Scan(np.ones(4, np.float32), 0.0, 0.1, 10.0))
        assert repeat(lidar, scan, newest.get)


@LAYOUTS
def test_payloads_that_are_no_messages_are_skipped_and_logged_once(endpoint, layout, caplog):
    with Node(ros(endpoint, layout=layout), "liar") as liar, Node(ros(endpoint, layout=layout), "victim") as victim:
        got = []
        subscription = victim.subscribe("/scan", SCAN, lambda scan, _: got.append(scan), SENSOR)
        scans = liar.publisher("/scan", SCAN, SENSOR)
        scan = laser_scan(1.0, "laser", Scan(np.ones(4, np.float32), 0.0, 0.1, 10.0))
        assert repeat(scans, scan, lambda: got)
        count = len(got)
        for payload in (b"", b"\0\1", b"\0\1\0\0", b"\xff" * 60, b"\0\1\0\0" + b"\xff" * 500, b"\0" * 100_000):
            scans.publish_raw(payload)
            time.sleep(0.02)
        assert eventually(lambda: subscription.invalid == 6)
        assert repeat(scans, scan, lambda: len(got) > count)
        warnings = [record for record in caplog.records if "skipped and counted" in record.message]
        assert len(warnings) == 1
        assert "/scan" in warnings[0].message


def test_a_callback_that_fails_silences_nobody(endpoint, caplog):
    with Node(ros(endpoint), "talker") as talker, Node(ros(endpoint), "listener") as listener:

        def fail(*_):
            raise ZeroDivisionError

        bad = listener.subscribe("/chatter", "std_msgs/msg/String", fail)
        good = listener.latest("/chatter", "std_msgs/msg/String")
        chatter = talker.publisher("/chatter", "std_msgs/msg/String")
        assert repeat(chatter, text("hello"), lambda: good.get() and bad.failed >= 2)
        assert any("the callback of /chatter failed" in record.message for record in caplog.records)


def test_messages_without_sense_are_logged_once(endpoint, caplog):
    with Node(ros(endpoint), "base") as base, Node(ros(endpoint), "bridge") as bridge:
        subscription = bridge.subscribe("/odom", "nav_msgs/msg/Odometry", lambda value, _: pose_from(value))
        nowhere = odometry(1.0, "odom", "base", Pose(float("nan"), 0.0))
        odometries = base.publisher("/odom", "nav_msgs/msg/Odometry")
        assert repeat(odometries, nowhere, lambda: subscription.invalid >= 3)
        assert subscription.received == subscription.failed == 0
        assert len([record for record in caplog.records if "finite" in record.message]) == 1


def test_a_slow_callback_keeps_the_newest_messages(endpoint):
    with Node(ros(endpoint), "talker") as talker, Node(ros(endpoint), "listener") as listener:
        got, release = [], threading.Event()

        def slow(value, _):
            release.wait(10.0)
            got.append(value.data)

        subscription = listener.subscribe("/count", "std_msgs/msg/Float32", slow, QoS(depth=3))
        other = listener.latest("/chatter", "std_msgs/msg/String")
        count = talker.publisher("/count", "std_msgs/msg/Float32")
        chatter = talker.publisher("/chatter", "std_msgs/msg/String")
        assert repeat(chatter, text("hello"), other.get)
        for number in range(50):
            count.publish(message("std_msgs/msg/Float32", data=float(number)))
        assert eventually(lambda: subscription.dropped >= 46)
        release.set()
        assert eventually(lambda: got[-3:] == [47.0, 48.0, 49.0])
        assert subscription.dropped + len(got) == 50


def test_closed_subscriptions_receive_no_more(endpoint):
    with Node(ros(endpoint), "talker") as talker, Node(ros(endpoint), "listener") as listener:
        newest = listener.latest("/chatter", "std_msgs/msg/String")
        chatter = talker.publisher("/chatter", "std_msgs/msg/String")
        assert repeat(chatter, text("one"), newest.get)
        newest.close()
        newest.close()
        chatter.publish(text("two"))
        time.sleep(0.2)
        assert newest.get()[0].data == "one"


def test_publishing_after_closing_says_so(endpoint):
    node = Node(ros(endpoint), "talker")
    chatter = node.publisher("/chatter", "std_msgs/msg/String")
    chatter.publish(text("nobody listens"))
    node.close()
    node.close()
    with pytest.raises(RosError, match="is the node closed"):
        chatter.publish(text("too late"))


def test_wrong_names_types_and_endpoints(endpoint):
    with Node(ros(endpoint), "node") as node:
        with pytest.raises(RosError, match="topic is made of"):
            node.publisher("/2d scan", SCAN)
        with pytest.raises(RosError, match="no message type"):
            node.publisher("/scan", "sensor_msgs/LaserScan")
        with pytest.raises(RosError, match="cannot serialise"):
            node.publisher("/flag", "std_msgs/msg/Int8").publish(message("std_msgs/msg/Int8", data=999))
    with pytest.raises(RosError, match="topic is made of"):
        Node(ros(endpoint), "no node")
    with pytest.raises(RosError, match="cannot join Zenoh"):
        Node(RosConfig(listen=(endpoint,), connect=()), "node")
