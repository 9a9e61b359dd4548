"""Parameters of the robot's network: the Zenoh endpoints, frames and topic names."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from common.bus.endpoint import is_loopback
from common.config import Section
from common.config.endpoint import RobotEndpoint
from common.errors import ConfigError
from deploy.ros_names import PRIVATE, segments


class RosConfig(Section):
    """ROS 2 over Zenoh: how topics map to keys, and where to connect."""

    layout: Literal["rmw_zenoh", "ros2dds"] = "rmw_zenoh"
    """Key layout: `rmw_zenoh` for robots whose RMW is Zenoh, `ros2dds` behind a zenoh-bridge-ros2dds."""
    distro: Literal["humble", "jazzy", "kilted"] = "jazzy"
    """ROS 2 distribution whose message definitions are used."""
    domain: Annotated[int, Field(ge=0, le=232)] = 0
    """ROS_DOMAIN_ID of the robot's nodes. From the environment, only `hd-deploy relay` takes it, for its DDS side."""
    namespace: str = ""
    """Prefix of every relative topic name, such as `robot1`."""
    node: str = "hd_bridge"
    """Node name in `ros2 node list`."""
    mode: Literal["auto", "peer", "client"] = "auto"
    """How to join the network. `peer`: talk to the other nodes directly, as ROS 2 nodes on one machine do. `client`: go
    through the router, as needed when it runs on another machine. `auto`: `peer` if `connect` names only this machine,
    else `client`."""
    connect: tuple[RobotEndpoint, ...] = ("tcp/127.0.0.1:7447",)
    """Zenoh endpoints to connect to: the robot's `rmw_zenohd` router or its zenoh-bridge-ros2dds."""
    listen: tuple[RobotEndpoint, ...] = ()
    """Zenoh endpoints to listen on; the bridge then acts as the router."""
    tls_ca: str | None = None
    """Certificate of the authority, from `hd-learner certificates`. Setting it makes all links of this network use
    mutual TLS; unencrypted links are refused."""
    tls_certificate: str | None = None
    """This process's certificate. If the process listens, it must name the addresses that others connect to."""
    tls_key: str | None = None
    """Private key of the certificate."""
    tls_access: str | None = None
    """Zenoh access rules (JSON), enforced where the bridge listens: which certificate may publish and command what.
    Default: every certificate of the authority may do everything."""

    @field_validator("namespace")
    @classmethod
    def _namespace_is_a_name(cls, value: str) -> str:
        if value.strip("/"):
            segments(value, "namespace")
        return value

    @field_validator("node")
    @classmethod
    def _node_is_a_name(cls, value: str) -> str:
        if len(segments(value, "node's name")) > 1 or "/" in value:
            raise ValueError("a node's name is one word without slashes, such as hd_bridge; see ros.namespace")
        return value

    @model_validator(mode="after")
    def _there_is_a_network(self) -> RosConfig:
        if not self.connect and not self.listen:
            raise ValueError("connect or listen needs an endpoint, such as tcp/127.0.0.1:7447")
        tls = [endpoint for endpoint in (*self.connect, *self.listen) if endpoint.startswith("tls/")]
        if tls and self.tls_ca is None:
            raise ValueError(f"{tls[0]} needs certificates: set tls_ca, tls_certificate and tls_key")
        return self


class FramesConfig(Section):
    """Coordinate frames."""

    map: str = "map"
    """Fixed frame in which the robot plans."""
    odom: str = "odom"
    """Odometry frame, when poses come from TF."""
    base: str = "base_link"
    """The robot's base frame."""

    @field_validator("map", "odom", "base")
    @classmethod
    def _without_slash(cls, value: str) -> str:
        # Headers are read without the slash of ROS 1 too.
        return value.lstrip("/")


class TopicsConfig(Section):
    """Topic names and their ROS types; an empty name disables a topic.

    Names that begin with `/` are absolute; all others are below `ros.namespace`.
    """

    odometry: str = "/odom"
    """IN nav_msgs/Odometry: pose and velocity."""
    scan: str = "/scan"
    """IN sensor_msgs/LaserScan, for `sensing.source: scan`."""
    points: str = ""
    """IN sensor_msgs/PointCloud2, for `sensing.source: points`."""
    map: str = ""
    """IN nav_msgs/OccupancyGrid of the robot's SLAM, for `sensing.source: grid`."""
    tf: str = "/tf"
    """IN tf2_msgs/TFMessage, for `sensing.pose: tf`."""
    tf_static: str = "/tf_static"
    """IN tf2_msgs/TFMessage, latched."""
    goal: str = "/goal_point"
    """IN geometry_msgs/PointStamped: a target; interrupts an exploration."""
    goal_pose: str = ""
    """IN geometry_msgs/PoseStamped: a target, as published by RViz's goal tool."""
    navigate_action: str = "~/navigate_to_pose"
    """ACTION nav2_msgs/NavigateToPose of the bridge's node: a target, with feedback and result. Only over Zenoh."""
    start: str = "/start_exploration"
    """IN std_msgs/Bool: true starts the task."""
    command: str = "/hd/command"
    """IN std_msgs/String: start, pause, resume, abort, return_home, reset, explore, stop, status, `goal X Y`."""
    emergency_stop: str = "/hd/emergency_stop"
    """IN std_msgs/Bool: true latches the emergency stop, whoever publishes it; only `hd-deploy command release`
    releases it."""
    joy: str = "/joy"
    """IN sensor_msgs/Joy: moving a stick takes over manual control."""
    waypoint: str = "/way_point"
    """OUT geometry_msgs/PointStamped: the next waypoint."""
    waypoint_pose: str = ""
    """OUT geometry_msgs/PoseStamped: the next waypoint for nav2 (`/goal_pose`)."""
    path: str = "/hd/path"
    """OUT nav_msgs/Path: the route beyond the waypoint."""
    beacon: str = "/hd/beacon"
    """OUT geometry_msgs/PointStamped: the chosen beacon."""
    status: str = "/hd/status"
    """OUT std_msgs/String: JSON of state, reason, explored area, distance, decision time."""
    acknowledgement: str = "/hd/acknowledgement"
    """OUT std_msgs/String: answer to every command, as JSON."""
    diagnostics: str = "/diagnostics"
    """OUT diagnostic_msgs/DiagnosticArray: levels of task, inputs, planner and watchdog."""
    markers: str = "/hd/markers"
    """OUT visualization_msgs/MarkerArray: graph, frontiers, beacons, attention."""
    scene: str = "/hd/scene"
    """OUT std_msgs/String: JSON of the same for pages and programs, with the probabilities of beacons and waypoints."""
    belief: str = "/hd/belief"
    """OUT nav_msgs/OccupancyGrid, transient local: the planner's map."""
    watchdog: str = "/hd/watchdog"
    """OUT std_msgs/String, transient local: the watchdog's mode, reason and the age of each of its inputs, as JSON."""
    velocity: str = "/cmd_vel"
    """OUT geometry_msgs/Twist or TwistStamped: published only by the watchdog."""
    stop: str = ""
    """OUT std_msgs/Int8 of the CMU stack: 0 go, 1 zero linear, 2 also zero yaw."""
    speed: str = ""
    """OUT std_msgs/Float32 of the CMU stack, m/s."""
    finished: str = "/exploration_finish"
    """OUT std_msgs/Bool: the task is done."""
    goal_reached: str = "/far_reach_goal_status"
    """OUT std_msgs/Bool: the navigation target is reached."""
    runtime: str = "/runtime"
    """OUT std_msgs/Float32: decision time, s."""
    explored_volume: str = "/explored_volume"
    """OUT std_msgs/Float32: points after a 0.5 m voxel filter times 0.125 m3 (`sensing.source: points`)."""
    travelling_distance: str = "/traveling_distance"
    """OUT std_msgs/Float32: metres travelled."""
    time_duration: str = "/time_duration"
    """OUT std_msgs/Float32: seconds since the first motion."""
    remap: dict[str, str] = Field(default_factory=dict)
    """Replaces topic names after everything else: from the name given above to the robot's own."""

    @field_validator("*")
    @classmethod
    def _topics_are_names(cls, value: str | dict[str, str], info: ValidationInfo) -> str | dict[str, str]:
        if isinstance(value, str):
            # An action may lie below its node.
            name = value.removeprefix(PRIVATE) if info.field_name == "navigate_action" else value
            if value:
                segments(name, "topic")
        else:
            for name in (*value, *value.values()):
                try:
                    segments(name, "topic")
                except ValueError as error:
                    raise ValueError(f"{error}, and not {name!r}") from None
        return value


def guest_of(config: RosConfig) -> RosConfig:
    """Return the settings by which others join a network whose router is the process with these settings."""
    if not config.listen:
        return config
    return config.model_copy(update={"listen": (), "connect": (*config.listen, *config.connect)})


def router_for_bridge(config: RosConfig, who: str) -> RosConfig:
    """Return the settings of a process that is the router which a bridge with these settings connects to.

    Where the bridge is the router itself, it joins that.

    Args:
        config: the bridge's own.
        who: the process, for the error.

    Raises:
        ConfigError: the bridge connects to another machine.
    """
    if config.listen:
        return guest_of(config)
    elsewhere = [endpoint for endpoint in config.connect if not is_loopback(endpoint)]
    if elsewhere or not config.connect:
        raise ConfigError(
            f"{who} is the router of the robot's Zenoh network, and ros.connect names "
            f"{', '.join(elsewhere) or 'nothing'}: give the endpoint to listen on with --listen, or that of an "
            "existing router with --connect"
        )
    return config.model_copy(update={"listen": config.connect, "connect": ()})
