"""What the bridge cannot do without: one topic that it senses by, and one that tells its pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from deploy.config import DeployConfig
from deploy.ros2.names import namespace, topic_name

_KINDS: Final = {
    "scan": "sensor_msgs/msg/LaserScan",
    "points": "sensor_msgs/msg/PointCloud2",
    "map": "nav_msgs/msg/OccupancyGrid",
    "odometry": "nav_msgs/msg/Odometry",
    "tf": "tf2_msgs/msg/TFMessage",
}


@dataclass(frozen=True, slots=True)
class Need:
    """A topic that the bridge needs.

    Attributes:
        name: of its parameter in `topics`.
        topic: absolute, in the robot's namespace and remapped; empty where the parameter is.
        kind: its ROS type.
    """

    name: str
    topic: str
    kind: str


def needs_of(config: DeployConfig) -> tuple[Need, Need]:
    """Return what a bridge senses by, and what tells its pose."""
    sensor = {"scan": "scan", "points": "points", "grid": "map"}[config.sensing.source]
    pose = "odometry" if config.sensing.pose == "odometry" else "tf"
    return _need(config, sensor), _need(config, pose)


def _need(config: DeployConfig, name: str) -> Need:
    topics = config.topics
    given = getattr(topics, name)
    topic = topic_name(given, namespace(config.ros.namespace), topics.remap) if given else ""
    return Need(name, topic, _KINDS[name])
