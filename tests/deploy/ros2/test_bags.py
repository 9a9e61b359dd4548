"""Our messages through real bag files of `rosbags`, an independent reader and writer of what `ros2 bag` writes."""

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer

from common.geometry import Pose, Scan
from deploy.ros2 import conversions as convert
from deploy.ros2.messages import deserialize, message, serialize, typestore
from tests.deploy.ros2.network import KINDS

SCAN = Scan(np.linspace(1.0, 5.0, 720, dtype=np.float32), -3.14, 0.00873, 20.0, 0.1)
MESSAGES = {
    "/scan": ("sensor_msgs/msg/LaserScan", convert.laser_scan(1.5, "laser", SCAN)),
    "/odom": ("nav_msgs/msg/Odometry", convert.odometry(1.5, "odom", "base_link", Pose(1.0, 2.0, 0.5), (0.3, 0.1))),
    "/points": ("sensor_msgs/msg/PointCloud2", convert.point_cloud(1.5, "map", np.ones((100, 4), np.float32))),
    "/map": ("nav_msgs/msg/OccupancyGrid", convert.occupancy_grid(1.5, "map", np.eye(4, dtype=np.int8), 0.1)),
    "/tf": (
        "tf2_msgs/msg/TFMessage",
        convert.transform_message([convert.transform(1.5, "map", "odom", Pose(1.0, 2.0, 0.5))]),
    ),
    "/way_point": ("geometry_msgs/msg/PointStamped", convert.point_stamped(1.5, "map", (3.0, 4.0))),
}


@pytest.fixture(params=[StoragePlugin.SQLITE3, StoragePlugin.MCAP], ids=["sqlite3", "mcap"])
def bag(request, tmp_path):
    path = tmp_path / "bag"
    with Writer(path, version=9, storage_plugin=request.param) as writer:
        for number, (topic, (kind, value)) in enumerate(MESSAGES.items()):
            connection = writer.add_connection(topic, kind, typestore=typestore())
            writer.write(connection, 1_500_000_000 + number, serialize(value, kind))
    return path


def test_readers_of_bags_understand_our_messages(bag):
    with AnyReader([bag]) as reader:
        seen = {c.topic: (c.msgtype, reader.deserialize(raw, c.msgtype)) for c, _, raw in reader.messages()}
    assert {topic: kind for topic, (kind, _) in seen.items()} == {topic: kind for topic, (kind, _) in MESSAGES.items()}
    assert np.array_equal(seen["/scan"][1].ranges, SCAN.ranges)
    assert seen["/way_point"][1].point.y == 4.0


def test_we_understand_what_bags_hold(bag):
    with AnyReader([bag]) as reader:
        raw = {connection.topic: bytes(data) for connection, _, data in reader.messages()}
    values = {topic: deserialize(raw[topic], kind) for topic, (kind, _) in MESSAGES.items()}
    assert np.array_equal(convert.scan_from(values["/scan"]).ranges, SCAN.ranges)
    assert convert.pose_from(values["/odom"])[2] == (0.3, 0.1)
    assert convert.points_from(values["/points"]).shape == (100, 4)
    assert np.array_equal(convert.grid_from(values["/map"])[0], np.eye(4))
    assert convert.transforms_from(values["/tf"])[0][1:3] == ("map", "odom")


@pytest.mark.parametrize("distro", ["humble", "kilted"])
def test_definitions_do_not_differ_between_distributions(distro):
    """A bridge set to the wrong distribution still reads the messages that it uses."""
    for kind in KINDS:
        payload = serialize(message(kind, distro), kind, distro)
        assert deserialize(payload, kind, "jazzy") is not None
