"""What the watchdog hears on the bus: callbacks that only note what came, and wake the loop."""

from __future__ import annotations

import logging
import struct
import time
from collections.abc import Callable
from typing import Final

from common.system.documents import parse_json
from deploy.config import DeployConfig
from deploy.ros2 import LATCHED, SENSOR, STATIC, Message, Node, QoS, Received, seconds
from deploy.ros2.names import topic_name
from deploy.safety.gate_state import GateMode
from deploy.safety.rules import GateRules

log = logging.getLogger(__name__)

STOPS: Final = QoS(transient_local=True)
"""Of the emergency stop: a button that was pressed before, and latches its message, counts. Not only the last message
does, for `false` releases nothing."""
# A Header's stamp stands first in CDR: 4 bytes of encapsulation, then int32 seconds and uint32 nanoseconds.
_STAMP: Final = {0: struct.Struct(">4xiI"), 1: struct.Struct("<4xiI")}


class WatchdogInputs:
    """Tells the rules of sensors, poses, the emergency stop, the joystick, the fence and other watchdogs."""

    def __init__(
        self,
        config: DeployConfig,
        rules: GateRules,
        identity: str,
        wake: Callable[[], None],
        wake_unless_clear: Callable[[], None],
    ) -> None:
        """Hear nothing yet.

        Args:
            config: whole tree.
            rules: are told of everything.
            identity: of this watchdog, by which it knows its own status.
            wake: lets the loop decide anew at once.
            wake_unless_clear: the same, for what changes nothing while velocities pass.
        """
        self._config = config
        self._rules = rules
        self._identity = identity
        self._wake = wake
        self._wake_unless_clear = wake_unless_clear
        self._other: tuple[float, str] | None = None
        self.robot: tuple[str, ...] = ()
        """Full names of the topics that make the robot drive or stand: another watchdog on one of them is a rival."""
        self._clock_offset: float | None = None
        self._fixed: dict[str, str] = {}

    def subscribe(self, node: Node) -> None:
        """Listen to the topics that the configuration names."""
        config, topics = self._config, self._config.topics
        self.robot = tuple(
            topic_name(topic, node.namespace, topics.remap) for topic in (topics.velocity, topics.stop) if topic
        )
        # What stops comes first: nothing moves before sensors are heard, and declarations travel in their order.
        if topics.emergency_stop:
            node.subscribe(topics.emergency_stop, "std_msgs/msg/Bool", self._heard_emergency_stop, STOPS)
        if topics.joy:
            node.subscribe(topics.joy, "sensor_msgs/msg/Joy", self._heard_joystick)
        node.subscribe(topics.watchdog, "std_msgs/msg/String", self._heard_watchdog)
        if config.safety.geofence:
            # Imported where there is a fence alone: a watchdog has to be at work soon.
            from deploy.safety.fence_watch import FenceWatch
            from deploy.safety.geofence import Geofence

            FenceWatch(
                Geofence.around_robot(config),
                topics,
                config.frames,
                self._heard_fence,
                by_tf=config.sensing.pose == "tf",
            ).subscribe(node)
        topic, kind, qos = {
            "scan": (topics.scan, "sensor_msgs/msg/LaserScan", SENSOR),
            "points": (topics.points, "sensor_msgs/msg/PointCloud2", SENSOR),
            "grid": (topics.map, "nav_msgs/msg/OccupancyGrid", LATCHED),
        }[config.sensing.source]
        node.subscribe_raw(topic, kind, self._heard_sensor, qos)
        if config.sensing.pose == "odometry":
            node.subscribe_raw(topics.odometry, "nav_msgs/msg/Odometry", self._heard_pose, SENSOR)
        else:
            if topics.tf_static:
                node.subscribe(topics.tf_static, "tf2_msgs/msg/TFMessage", self._heard_static_transforms, STATIC)
            node.subscribe(topics.tf, "tf2_msgs/msg/TFMessage", self._heard_transforms)

    def robot_time(self, now: float) -> float:
        """Return the robot's clock at a moment of this machine's monotonic one, seconds; 0 while it is not known."""
        time = 0.0 if self._clock_offset is None else now + self._clock_offset
        return time if 0.0 <= time < 2**31 - 1 else 0.0

    def another_since(self, moment: float) -> bool:
        """Whether another watchdog was heard after a moment."""
        return self._other is not None and self._other[0] > moment

    def _heard_sensor(self, payload: bytes, received: Received) -> None:
        del payload
        self._rules.sensor_time = received.time
        self._wake_unless_clear()

    def _heard_pose(self, payload: bytes, received: Received) -> None:
        self._rules.pose_time = received.time
        if len(payload) >= 12 and payload[1] in _STAMP:
            sent, nanoseconds = _STAMP[payload[1]].unpack_from(payload)
            self._note_clock(sent + nanoseconds * 1e-9, received)
        self._wake_unless_clear()

    def _heard_transforms(self, transforms: Message, received: Received) -> None:
        # SLAM's own transform must not hide that the robot's odometry has stopped.
        stamps = [
            seconds(one.header.stamp)
            for one in transforms.transforms
            if self._carries_base(one.child_frame_id.lstrip("/"))
        ]
        if stamps:
            self._rules.pose_time = received.time
            self._note_clock(max(stamps), received)
            self._wake_unless_clear()

    def _heard_static_transforms(self, transforms: Message, received: Received) -> None:
        del received
        for one in transforms.transforms:
            self._fixed[one.child_frame_id.lstrip("/")] = one.header.frame_id.lstrip("/")

    def _carries_base(self, frame: str) -> bool:
        """Whether a frame is the base's, or one that the base is fixed to, such as base_footprint."""
        above: str | None = self._config.frames.base
        # No longer than there are links: two publishers may make a ring of them.
        for _ in range(len(self._fixed) + 1):
            if above is None or above == frame:
                break
            above = self._fixed.get(above)
        return above == frame

    def _heard_fence(self, outside: str) -> None:
        self._rules.outside = outside
        self._wake()

    def _heard_emergency_stop(self, stop: Message, received: Received) -> None:
        if stop.data:
            log.debug("emergency stop received %.3f s ago", time.monotonic() - received.time)
            self._rules.latch(self._config.topics.emergency_stop)
            self._wake()

    def _heard_joystick(self, joy: Message, received: Received) -> None:
        self._rules.joystick([float(axis) for axis in joy.axes], received.time)
        self._wake()

    def _heard_watchdog(self, status: Message, received: Received) -> None:
        try:
            told = parse_json(status.data)
            other, mode, robot = told["watchdog"], told["mode"], {str(topic) for topic in told["robot"]}
        except (ValueError, TypeError, KeyError):
            return
        # One that only waits for its end gives way by itself.
        if other == self._identity or mode == GateMode.BRIDGE_GONE or robot.isdisjoint(self.robot):
            return
        if self._rules.bridge_gone:
            self._wake()
        elif self._other is None or self._other[1] != other:
            log.warning("another watchdog sends velocities as well: is a second bridge running for this robot?")
        self._other = received.time, other
        self._rules.rival_time = received.time

    def _note_clock(self, stamp: float, received: Received) -> None:
        """Learn the robot's clock from poses alone: a map that is latched is old, and a lidar may have its own."""
        self._clock_offset = stamp - received.time if stamp > 0.0 else None
