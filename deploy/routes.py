"""The topics of a profile between robot and bridge, with their types, directions and QoS."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

from deploy.config import DeployConfig
from deploy.needs import needs_of
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
        alone: no other node may publish it; where the robot's own stack drives, that publishes velocities, too.
        any_durability: publishers are heard from the first moment whether they keep their last message or not.
        setting: the parameter that names it, such as ``topics.scan``.
        mirrored: the relay listens in Zenoh only while somebody in DDS does, because the bridge asks who hears it.
    """

    topic: str
    kind: str
    direction: Direction
    qos: QoS = RELIABLE
    needed: bool = False
    moves: bool = False
    alone: bool = False
    any_durability: bool = False
    setting: str = ""
    mirrored: bool = False


def routes_of(config: DeployConfig) -> list[Route]:
    """Return the routes of a robot, those of the bridge and of its watchdog.

    Raises:
        RosError: a name is malformed, or one topic is to go both ways.
    """
    by_topic: dict[str, Route] = {}
    for route in named_routes(config):
        other = by_topic.setdefault(route.topic, route)
        if other.direction is not route.direction:
            raise RosError(
                f"{route.topic} would be relayed in both directions, and the bridge would receive its own messages: "
                "two parameters of `topics`, an input and an output, have this name; rename one of them"
            )
        if other.kind != route.kind:
            raise RosError(f"{route.topic} has two types, {other.kind} and {route.kind}: rename one of the topics")
    return list(by_topic.values())


def named_routes(config: DeployConfig) -> list[Route]:
    """Return a route for each topic that has a name, whether they can be relayed together or not.

    Raises:
        RosError: a name is malformed.
    """
    return [*_to_bridge(config), *_to_robot(config)]


def mismatch(route: Route, node: str, kind: str, told: str, ours: str) -> str:
    """Say why nothing goes between the bridge and another node on a topic; empty where it does.

    Args:
        route: of the topic.
        node: full name of the other one.
        kind: message type that it speaks.
        told: hash of its type, or empty where it tells none.
        ours: hash of the same type here, or empty where hashes need not be the same.
    """
    what = f"{node} speaks {kind} on {route.topic}, and the profile {route.kind}"
    if kind != route.kind:
        if "Twist" in kind and route.moves:
            return f"{what}: set driving.message={kind.rsplit('/', 1)[1]}"
        return f"{what}: no message goes between them; remap one of the two"
    if told and ours and told != ours:
        return (
            f"{node} has another definition of {kind} on {route.topic} ({told}, here {ours}): set ros.distro to the "
            "robot's distribution"
        )
    return ""


def _to_bridge(config: DeployConfig) -> list[Route]:
    topics = config.topics
    needed = {need.name for need in needs_of(config)}
    wanted = [
        ("odometry", "nav_msgs/msg/Odometry", _POSES),
        ("tf", "tf2_msgs/msg/TFMessage", _TRANSFORMS),
        ("tf_static", "tf2_msgs/msg/TFMessage", STATIC),
        ("scan", "sensor_msgs/msg/LaserScan", SENSOR),
        ("points", "sensor_msgs/msg/PointCloud2", SENSOR if config.sensing.pose == "tf" else RELIABLE),
        ("map", "nav_msgs/msg/OccupancyGrid", LATCHED),
        ("command", "std_msgs/msg/String", RELIABLE),
        ("start", "std_msgs/msg/Bool", RELIABLE),
        ("goal", "geometry_msgs/msg/PointStamped", RELIABLE),
        ("goal_pose", "geometry_msgs/msg/PoseStamped", RELIABLE),
        ("emergency_stop", "std_msgs/msg/Bool", QoS(transient_local=True)),
        ("joy", "sensor_msgs/msg/Joy", RELIABLE),
    ]
    return [
        Route(
            _absolute(getattr(topics, name), config),
            kind,
            Direction.TO_BRIDGE,
            qos,
            name in needed,
            # Nobody presses a button again because the first press was not heard.
            any_durability=name == "emergency_stop",
            setting=f"topics.{name}",
        )
        for name, kind, qos in wanted
        if getattr(topics, name)
    ]


def _to_robot(config: DeployConfig) -> list[Route]:
    topics = config.topics
    wanted = [
        ("velocity", f"geometry_msgs/msg/{config.driving.message}", RELIABLE, True),
        ("stop", "std_msgs/msg/Int8", RELIABLE, True),
        ("waypoint", "geometry_msgs/msg/PointStamped", RELIABLE, False),
        ("waypoint_pose", "geometry_msgs/msg/PoseStamped", RELIABLE, False),
        ("path", "nav_msgs/msg/Path", RELIABLE, False),
        ("beacon", "geometry_msgs/msg/PointStamped", RELIABLE, False),
        ("status", "std_msgs/msg/String", RELIABLE, False),
        ("acknowledgement", "std_msgs/msg/String", RELIABLE, False),
        ("diagnostics", "diagnostic_msgs/msg/DiagnosticArray", RELIABLE, False),
        ("markers", "visualization_msgs/msg/MarkerArray", QoS(depth=1), False),
        ("scene", "std_msgs/msg/String", QoS(depth=1), False),
        ("belief", "nav_msgs/msg/OccupancyGrid", LATCHED, False),
        ("watchdog", "std_msgs/msg/String", LATCHED, False),
        ("speed", "std_msgs/msg/Float32", RELIABLE, False),
        ("finished", "std_msgs/msg/Bool", RELIABLE, False),
        ("goal_reached", "std_msgs/msg/Bool", RELIABLE, False),
        ("runtime", "std_msgs/msg/Float32", RELIABLE, False),
        ("explored_volume", "std_msgs/msg/Float32", RELIABLE, False),
        ("travelling_distance", "std_msgs/msg/Float32", RELIABLE, False),
        ("time_duration", "std_msgs/msg/Float32", RELIABLE, False),
    ]
    return [
        Route(
            _absolute(getattr(topics, name), config),
            kind,
            Direction.TO_ROBOT,
            qos,
            moves=moves,
            alone=moves and (name != "velocity" or config.driving.enabled),
            setting=f"topics.{name}",
            mirrored=name in {"waypoint", "waypoint_pose"},
        )
        for name, kind, qos, moves in wanted
        if getattr(topics, name)
    ]


def _absolute(topic: str, config: DeployConfig) -> str:
    return topic_name(topic, namespace(config.ros.namespace), config.topics.remap)
