"""One robot's topics, as channels of a page: the newest of each is read when the page is updated, and only then."""

from __future__ import annotations

import functools
import logging
import math
import re
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from common.errors import HDError
from common.geometry import Pose
from common.ids import ID_PATTERN
from common.messages.places import centimetres
from common.page.hub import Hub
from common.system.documents import DocumentError, parse_json
from common.system.steady_time import steady_time
from deploy.config import DeployConfig
from deploy.ros2 import LATCHED, RELIABLE, SENSOR, QoS, RosError
from deploy.ros2.conversions import grid_from, path_from, points_from, pose_from, scan_from
from deploy.ros2.messages import Message, deserialize
from deploy.ros2.names import namespace, topic_name
from deploy.tf.transform import Transform

log = logging.getLogger(__name__)

SILENT_SECONDS: Final = 3.0
"""A robot that says nothing for so long is shown as silent."""
_STEP: Final = 0.1
_MAX_POINTS: Final = 400
_MAX_PATH: Final = 500
_HEIGHTS: Final = (0.1, 2.0)
_SECONDS: Final = re.compile(r"\d+(\.\d+)? s\b")
_ORDER: Final = ("status", "odometry", "watchdog", "scene", "path", "belief", "scan", "points")

Roles = Mapping[str, tuple[str, str, QoS]]
"""Absolute topic, message type and quality of service, by what the topic is to the page."""


def roles_of(config: DeployConfig) -> Roles:
    """Return the topics of a robot that the page reads."""
    topics, within = config.topics, namespace(config.ros.namespace)
    newest = QoS(depth=1)
    wanted = {
        "status": (topics.status, "std_msgs/msg/String", newest),
        "watchdog": (topics.watchdog, "std_msgs/msg/String", LATCHED),
        "scene": (topics.scene, "std_msgs/msg/String", newest),
        "belief": (topics.belief, "nav_msgs/msg/OccupancyGrid", LATCHED),
        "path": (topics.path, "nav_msgs/msg/Path", newest),
        "runtime": (topics.runtime, "std_msgs/msg/Float32", RELIABLE),
    }
    if config.sensing.pose == "odometry":
        wanted["odometry"] = (topics.odometry, "nav_msgs/msg/Odometry", SENSOR)
    if config.sensing.source == "scan":
        wanted["scan"] = (topics.scan, "sensor_msgs/msg/LaserScan", SENSOR)
    elif config.sensing.source == "points":
        wanted["points"] = (topics.points, "sensor_msgs/msg/PointCloud2", SENSOR)
    return {
        role: (topic_name(topic, within, topics.remap), kind, qos)
        for role, (topic, kind, qos) in wanted.items()
        if topic
    }


class RobotFeed:
    """What is known of one robot; `take` may be called from any thread, `refresh` from one.

    Attributes:
        name: of the robot, as its status tells; empty before the first.
    """

    def __init__(self, config: DeployConfig, clock: Callable[[], float] | None = None) -> None:
        """Read the topics of a robot with this configuration.

        Args:
            config: of the robot: where its scans come from and where its lidar is.
            clock: seconds since 1970, of the moment that is shown; this one when not given.
        """
        self.name = ""
        self._config = config
        # Ages and curves must not jump when this machine's clock is set; events have the time of day.
        self._clock = clock or steady_time
        self._time_of_day = clock or time.time
        self._lock = threading.Lock()
        self._newest: dict[str, bytes] = {}
        self._decisions: list[tuple[float, bytes]] = []
        self._heard = float("-inf")
        self._kinds = {role: kind for role, (_, kind, _) in roles_of(config).items()}
        self._bad: set[str] = set()
        self._pose: Pose | None = None
        self._last_on_way: tuple[float, float] | None = None
        self._last_event: tuple[Any, ...] | None = None
        self._forgotten = False

    def take(self, role: str, payload: bytes) -> None:
        """Take in a message; of all topics but the decision times only the newest counts.

        Args:
            role: one of `roles_of`.
            payload: CDR.
        """
        with self._lock:
            if role == "runtime":
                self._decisions.append((self._clock(), payload))
                del self._decisions[:-100]
            else:
                self._newest[role] = payload
            if role == "status":
                self._heard = self._clock()

    def forget(self) -> None:
        """Begin anew, as a recording does that goes back: with the next refresh nothing is known of the robot."""
        with self._lock:
            self._newest.clear()
            self._decisions.clear()
        self._pose = self._last_on_way = self._last_event = None
        self._forgotten = True

    @property
    def age(self) -> float:
        """Seconds since the last status."""
        return self._clock() - self._heard

    def refresh(self, hub: Hub) -> None:
        """Put what came since the last time into the hub, as channels ``robot/NAME/...``."""
        with self._lock:
            newest, self._newest = self._newest, {}
            decisions, self._decisions = self._decisions, []
        if not self.name and "status" not in newest:
            # Whose it is will be known with the first status.
            with self._lock:
                self._newest = {**newest, **self._newest}
                self._decisions = [*decisions, *self._decisions]
            return
        if self._forgotten and self.name:
            hub.drop(self._channel(""))
        self._forgotten = False
        # The status tells the name, and the pose where no odometry does; the scan is placed by either.
        for role in sorted(newest, key=_ORDER.index):
            self._read(role, functools.partial(self._put, hub, role, newest[role]))
            if not self.name:
                return
        for at, payload in decisions:
            self._read("runtime", functools.partial(self._put_decision, hub, at, payload))

    def _read(self, role: str, read: Callable[[], None]) -> None:
        try:
            read()
        except (HDError, DocumentError) as error:
            if role not in self._bad:
                self._bad.add(role)
                log.warning("the %s of robot %r cannot be shown: %s", role, self.name, error)
        else:
            self._bad.discard(role)

    def _put(self, hub: Hub, role: str, payload: bytes) -> None:
        if role in {"scan", "points"} and not hub.watched(self._channel("scan")):
            return
        message = deserialize(payload, self._kinds[role], self._config.ros.distro)
        getattr(self, f"_put_{role}")(hub, message)

    def _put_status(self, hub: Hub, message: Message) -> None:
        status = _object(message.data)
        name = status.get("name")
        if not isinstance(name, str) or not ID_PATTERN.fullmatch(name):
            raise RosError(f"a status must tell the robot's name, got {str(name)[:40]!r}")
        self.name = self.name or name
        hub.put(self._channel("status"), status)
        pose = _pose_of(status.get("pose"))
        if "odometry" not in self._kinds and pose is not None:
            self._put_pose(hub, pose, None)
        event = tuple(status.get(name) for name in ("state", "reason", "planner", "guard", "relieved"))
        # What waits tells how long, and is no news twice a second.
        words = tuple(_SECONDS.sub("s", part) if isinstance(part, str) else part for part in event)
        if words != self._last_event:
            self._last_event = words
            hub.append(self._channel("events"), [round(self._time_of_day(), 2), *event])

    def _put_watchdog(self, hub: Hub, message: Message) -> None:
        hub.put(self._channel("watchdog"), _object(message.data))

    def _put_scene(self, hub: Hub, message: Message) -> None:
        hub.put(self._channel("scene"), _object(message.data))

    def _put_belief(self, hub: Hub, message: Message) -> None:
        cells, resolution, (x, y, yaw) = grid_from(message)
        if yaw:
            raise RosError(f"a belief must not be turned, got a yaw of {yaw:g} rad")
        hub.grid(self._channel("belief"), cells, resolution, (x, y))

    def _put_path(self, hub: Hub, message: Message) -> None:
        hub.put(self._channel("path"), centimetres(path_from(message)[:_MAX_PATH]))

    def _put_odometry(self, hub: Hub, message: Message) -> None:
        _, pose, velocity = pose_from(message)
        self._put_pose(hub, pose, velocity)

    def _put_pose(self, hub: Hub, pose: Pose, velocity: tuple[float, float] | None) -> None:
        self._pose = pose
        numbers = [pose.x, pose.y, pose.yaw, *(velocity or ())]
        hub.put(self._channel("pose"), [round(number, 3) for number in numbers])
        if self._last_on_way is None or pose.distance_to(self._last_on_way) >= _STEP:
            self._last_on_way = pose.position
            hub.append(self._channel("way"), [round(pose.x, 2), round(pose.y, 2)])

    def _put_scan(self, hub: Hub, message: Message) -> None:
        scan, place = scan_from(message), self._sensor_place(message)
        if place is None:
            return
        each = len(scan.ranges) // _MAX_POINTS + 1
        ranges = scan.ranges[::each]
        angles = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))[::each]
        met = (ranges >= scan.range_min) & (ranges < scan.range_max)
        ends = ranges[met, None] * np.stack([np.cos(angles[met]), np.sin(angles[met]), np.zeros(met.sum())], axis=1)
        hub.put(self._channel("scan"), centimetres(place.apply(ends)[:, :2]))

    def _put_points(self, hub: Hub, message: Message) -> None:
        points = points_from(message)[:, :3].astype(np.float64)
        points = points[(points[:, 2] >= _HEIGHTS[0]) & (points[:, 2] <= _HEIGHTS[1])]
        points = points[:: len(points) // _MAX_POINTS + 1]
        if self._config.sensing.points_frame == "sensor":
            place = self._sensor_place(message)
            if place is None:
                return
            points = place.apply(points)
        hub.put(self._channel("scan"), centimetres(points[:, :2]))

    def _sensor_place(self, message: Message) -> Transform | None:
        """Return where a sensor is on the map, None while the robot's pose is not known; the page reads no TF."""
        pose = self._pose
        if pose is None:
            return None
        base = Transform.planar(pose.x, pose.y, pose.yaw)
        in_base = message.header.frame_id.lstrip("/") == self._config.frames.base
        return base if in_base else base @ Transform.planar(*self._config.sensing.sensor_offset)

    def _put_decision(self, hub: Hub, at: float, payload: bytes) -> None:
        seconds = deserialize(payload, self._kinds["runtime"], self._config.ros.distro).data
        if math.isfinite(seconds):
            hub.append(self._channel("decisions"), [round(at, 2), round(float(seconds), 4)])

    def _channel(self, name: str) -> str:
        return f"robot/{self.name}/{name}"


def _object(text: str) -> dict[str, Any]:
    found = parse_json(text)
    if not isinstance(found, dict):
        raise DocumentError(f"must be a JSON object, got {type(found).__name__}")
    return found


def _pose_of(value: Any) -> Pose | None:
    """Return a pose as a status tells it: x, y, yaw."""
    if not isinstance(value, list) or len(value) != 3:
        return None
    return Pose(*value) if all(isinstance(each, int | float) for each in value) else None
