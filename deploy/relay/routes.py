"""What goes from one network to the other: the topics of a profile, with their types, directions and QoS."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

from deploy.config import DeployConfig
from deploy.ros2 import LATCHED, RELIABLE, SENSOR, STATIC, QoS, RosError
from deploy.ros2.names import namespace, topic_name

_POSES: Final = QoS(depth=50)
_TRANSFORMS: Final = QoS(depth=100)


class Direction(Enum):
    """Which way messages go."""

    TO_BRIDGE = "to the bridge"
    """From DDS to Zenoh: what the robot tells."""
    TO_ROBOT = "to the robot"
    """From Zenoh to DDS: what the bridge tells."""


@dataclass(frozen=True, slots=True)
class Route:
    """One topic.

    Attributes:
        topic: absolute name, the same in both networks.
        kind: message type.
        direction: which way its messages go; never both, so that nothing comes back.
        qos: asked of publishers where messages come from, and offered where they go to.
        needed: the bridge stands without it.
        moves: its messages move or stop the robot.
        any_durability: publishers are heard from the first moment whether they keep their last message or not.
    """

    topic: str
    kind: str
    direction: Direction
    qos: QoS = RELIABLE
    needed: bool = False
    moves: bool = False
    any_durability: bool = False


def routes_of(config: DeployConfig) -> list[Route]:
    """Return the routes of a robot, those of the bridge and of its watchdog.

    Raises:
        RosError: a name is malformed, or one topic is to go both ways.
    """
    routes = [*_to_bridge(config), *_to_robot(config)]
    by_topic: dict[str, Route] = {}
    for route in routes:
        other = by_topic.setdefault(route.topic, route)
        if other.direction is not route.direction:
            raise RosError(
                f"{route.topic} would be relayed in both directions, and the bridge would receive its own messages: "
                "two parameters of `topics`, an input and an output, have this name; rename one of them"
            )
        if other.kind != route.kind:
            raise RosError(f"{route.topic} has two types, {other.kind} and {route.kind}: rename one of the topics")
    return list(by_topic.values())


def _to_bridge(config: DeployConfig) -> list[Route]:
    topics, sensing = config.topics, config.sensing
    by_tf = sensing.pose == "tf"
    wanted = [
        (topics.odometry, "nav_msgs/msg/Odometry", _POSES, not by_tf),
        (topics.tf, "tf2_msgs/msg/TFMessage", _TRANSFORMS, by_tf),
        (topics.tf_static, "tf2_msgs/msg/TFMessage", STATIC, False),
        (topics.scan, "sensor_msgs/msg/LaserScan", SENSOR, sensing.source == "scan"),
        (topics.points, "sensor_msgs/msg/PointCloud2", SENSOR if by_tf else RELIABLE, sensing.source == "points"),
        (topics.map, "nav_msgs/msg/OccupancyGrid", LATCHED, sensing.source == "grid"),
        (topics.command, "std_msgs/msg/String", RELIABLE, False),
        (topics.start, "std_msgs/msg/Bool", RELIABLE, False),
        (topics.goal, "geometry_msgs/msg/PointStamped", RELIABLE, False),
        (topics.goal_pose, "geometry_msgs/msg/PoseStamped", RELIABLE, False),
        (topics.emergency_stop, "std_msgs/msg/Bool", QoS(transient_local=True), False),
        (topics.joy, "sensor_msgs/msg/Joy", RELIABLE, False),
    ]
    return [
        Route(
            _absolute(topic, config),
            kind,
            Direction.TO_BRIDGE,
            qos,
            needed,
            # Nobody presses a button again because the first press was not heard.
            any_durability=topic == topics.emergency_stop,
        )
        for topic, kind, qos, needed in wanted
        if topic
    ]


def _to_robot(config: DeployConfig) -> list[Route]:
    topics = config.topics
    wanted = [
        (topics.velocity, f"geometry_msgs/msg/{config.driving.message}", RELIABLE, True),
        (topics.stop, "std_msgs/msg/Int8", RELIABLE, True),
        (topics.waypoint, "geometry_msgs/msg/PointStamped", RELIABLE, False),
        (topics.waypoint_pose, "geometry_msgs/msg/PoseStamped", RELIABLE, False),
        (topics.path, "nav_msgs/msg/Path", RELIABLE, False),
        (topics.beacon, "geometry_msgs/msg/PointStamped", RELIABLE, False),
        (topics.status, "std_msgs/msg/String", RELIABLE, False),
        (topics.acknowledgement, "std_msgs/msg/String", RELIABLE, False),
        (topics.diagnostics, "diagnostic_msgs/msg/DiagnosticArray", RELIABLE, False),
        (topics.markers, "visualization_msgs/msg/MarkerArray", QoS(depth=1), False),
        (topics.scene, "std_msgs/msg/String", QoS(depth=1), False),
        (topics.belief, "nav_msgs/msg/OccupancyGrid", LATCHED, False),
        (topics.watchdog, "std_msgs/msg/String", LATCHED, False),
        (topics.speed, "std_msgs/msg/Float32", RELIABLE, False),
        (topics.finished, "std_msgs/msg/Bool", RELIABLE, False),
        (topics.goal_reached, "std_msgs/msg/Bool", RELIABLE, False),
        (topics.runtime, "std_msgs/msg/Float32", RELIABLE, False),
        (topics.explored_volume, "std_msgs/msg/Float32", RELIABLE, False),
        (topics.travelling_distance, "std_msgs/msg/Float32", RELIABLE, False),
        (topics.time_duration, "std_msgs/msg/Float32", RELIABLE, False),
    ]
    return [
        Route(_absolute(topic, config), kind, Direction.TO_ROBOT, qos, moves=moves)
        for topic, kind, qos, moves in wanted
        if topic
    ]


def _absolute(topic: str, config: DeployConfig) -> str:
    return topic_name(topic, namespace(config.ros.namespace), config.topics.remap)
