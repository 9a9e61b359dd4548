"""What the relay costs and loses: scans, clouds and odometry from DDS to Zenoh, commands back, each with its latency.

`.venv-ros/bin/python -m benchmarks.relay` (after `make test-ros`): needs rclpy. The robot is a process of its own.
"""

from __future__ import annotations

import importlib.util
import multiprocessing
import os
import statistics
import subprocess
import sys
import time
from typing import Any

import numpy as np
import psutil

from deploy.network_config import RosConfig
from deploy.robot.deployment import free_endpoint
from deploy.ros2 import SENSOR, Node
from deploy.ros2.conversions import twist

SECONDS = 20.0
DOMAIN = 99
BEAMS, POINTS = 720, 30_000
SCAN_RATE, CLOUD_RATE, ODOMETRY_RATE, COMMAND_RATE = 20.0, 10.0, 50.0, 20.0


def robot(begin: Any, results: Any) -> None:
    """Publish in DDS, and count the commands that come back."""
    import rclpy
    from geometry_msgs.msg import Twist
    from nav_msgs.msg import Odometry
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import LaserScan, PointCloud2, PointField

    rclpy.init(domain_id=DOMAIN)
    node = rclpy.create_node("base")
    latencies: list[float] = []
    node.create_subscription(Twist, "/cmd_vel", lambda command: latencies.append(time.time() - command.linear.x), 10)
    scan = LaserScan(angle_increment=0.01, range_max=20.0, ranges=[5.0] * BEAMS)
    points = np.ones((POINTS, 4), np.float32)
    cloud = PointCloud2(height=1, width=POINTS, point_step=16, row_step=16 * POINTS, data=points.tobytes())
    cloud.fields = [
        PointField(name=name, offset=4 * number, datatype=7, count=1)
        for number, name in enumerate(("x", "y", "z", "intensity"))
    ]
    sent = {"scans": 0, "clouds": 0, "odometry": 0}

    def timer(name: str, publisher: Any, message: Any, rate: float) -> None:
        def publish() -> None:
            if not begin.is_set():
                return
            seconds, rest = divmod(time.time_ns(), 10**9)
            message.header.stamp.sec, message.header.stamp.nanosec = seconds, rest
            publisher.publish(message)
            sent[name] += 1

        node.create_timer(1.0 / rate, publish)

    timer("scans", node.create_publisher(LaserScan, "/scan", qos_profile_sensor_data), scan, SCAN_RATE)
    timer("clouds", node.create_publisher(PointCloud2, "/cloud", 5), cloud, CLOUD_RATE)
    timer("odometry", node.create_publisher(Odometry, "/odom", 10), Odometry(), ODOMETRY_RATE)
    if not begin.wait(60.0):
        sys.exit("nobody began")
    end = time.monotonic() + SECONDS
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
    begin.clear()
    results.put((sent, latencies))
    time.sleep(1.0)


def main() -> None:
    """Measure and print a table."""
    if importlib.util.find_spec("rclpy") is None:
        sys.exit("error: rclpy is not installed here: run `make ros-environment`, then .venv-ros/bin/python")
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    endpoint = free_endpoint()
    settings = [f"ros.domain={DOMAIN}", "topics.points=/cloud", "sensing.source=points"]
    options = [part for each in settings for part in ("--set", each)]
    relay = subprocess.Popen([sys.executable, "-m", "deploy", "relay", *options, "--listen", endpoint])
    context = multiprocessing.get_context("spawn")
    begin, results = context.Event(), context.Queue()
    process = context.Process(target=robot, args=(begin, results))
    process.start()
    latencies: dict[str, list[float]] = {"scans": [], "clouds": [], "odometry": []}

    def take(name: str) -> Any:
        def note(message: Any, how: Any) -> None:
            del how
            latencies[name].append(time.time() - message.header.stamp.sec - message.header.stamp.nanosec * 1e-9)

        return note

    with Node(RosConfig(connect=(endpoint,), domain=DOMAIN), "hd_bridge") as node:
        node.subscribe("/scan", "sensor_msgs/msg/LaserScan", take("scans"), SENSOR)
        node.subscribe("/cloud", "sensor_msgs/msg/PointCloud2", take("clouds"))
        node.subscribe("/odom", "nav_msgs/msg/Odometry", take("odometry"))
        velocity = node.publisher("/cmd_vel", "geometry_msgs/msg/Twist")
        time.sleep(10.0)
        watched = psutil.Process(relay.pid)
        busy, began = sum(watched.cpu_times()[:2]), time.monotonic()
        begin.set()
        commands = 0
        while begin.is_set():
            # The time of sending travels as the speed.
            velocity.publish(twist(time.time(), 0.0))
            commands += 1
            time.sleep(1.0 / COMMAND_RATE)
        share = (sum(watched.cpu_times()[:2]) - busy) / (time.monotonic() - began)
        sent, back = results.get(timeout=10.0)
        time.sleep(0.5)
    sent["commands"], latencies["commands"] = commands, back
    print("| messages | sent | came | median (ms) | 95 % (ms) |\n| --- | --- | --- | --- | --- |")
    for name, found in latencies.items():
        spread = statistics.quantiles(found, n=20)
        print(f"| {name} | {sent[name]} | {len(found)} | {1e3 * spread[9]:.1f} | {1e3 * spread[18]:.1f} |")
    print(f"relay: {share:.1%} of a core, {watched.memory_info().rss >> 20} MB")
    relay.terminate()
    relay.wait()
    process.join(10.0)


if __name__ == "__main__":
    main()
