"""What the bridge hears: its callbacks only store, the decision loop does the work."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from deploy.config import DeployConfig
from deploy.mapping.frames import plain
from deploy.mapping.robot_map import RobotMap
from deploy.ros2 import LATCHED, RELIABLE, SENSOR, STATIC, Message, Node, QoS, Received, RosError, seconds
from deploy.ros2.conversions import (
    cloud_note,
    grid_from,
    points_from,
    pose_from,
    scan_from,
    scan_note,
    sweep_of,
    times_from,
    transforms_from,
)
from deploy.ros2.no_return import understood
from deploy.safety.health import Fault, FaultKind, HealthMonitor
from deploy.safety.sensor_watch import MAX_LIDARS
from deploy.safety.sight import Sight

# Poses come fast; those that a busy moment leaves waiting are still good for the buffer.
_POSES = QoS(depth=50)
_TRANSFORMS = QoS(depth=100)


class Inputs:
    """Puts sensor messages and poses where the loop finds them.

    The methods `take_...` take messages from anywhere, so that a recording can be fed to them as well.

    Attributes:
        velocity: measured (m/s, rad/s), zeros while no odometry told it.
        stamp: time of the newest pose, seconds of the robot's clock; that of this machine before the first.
    """

    def __init__(self, config: DeployConfig, robot_map: RobotMap, health: HealthMonitor) -> None:
        """Feed a map and a health monitor."""
        self._config = config
        self._map = robot_map
        self._health = health
        self._arrived: dict[str, float] = {}
        self._sight: dict[tuple[str, str], Sight] = {}
        self._lock = threading.Lock()
        self._travelled = 0.0
        self._last_position: tuple[float, float] | None = None
        self.velocity = (0.0, 0.0)
        self.stamp = time.time()

    def subscribe(self, node: Node) -> None:
        """Listen to the topics that the configuration names."""
        topics, sensing = self._config.topics, self._config.sensing
        by_tf = sensing.pose == "tf"
        wanted: list[tuple[str, str, Callable[[Message, Received], None], QoS]] = [
            (topics.odometry, "nav_msgs/msg/Odometry", self.take_odometry, _POSES),
            (topics.tf, "tf2_msgs/msg/TFMessage", self.take_transforms, _TRANSFORMS),
            (topics.tf_static, "tf2_msgs/msg/TFMessage", self.take_static_transforms, STATIC),
            (topics.scan, "sensor_msgs/msg/LaserScan", self.take_scan, SENSOR),
            (topics.points, "sensor_msgs/msg/PointCloud2", self.take_points, SENSOR if by_tf else RELIABLE),
            (topics.map, "nav_msgs/msg/OccupancyGrid", self.take_grid, LATCHED),
        ]
        for topic, kind, callback, qos in wanted:
            if topic:
                node.subscribe(topic, kind, callback, qos)

    def ages(self) -> dict[str, float]:
        """Return the seconds since the last message of each input that ever came."""
        now = time.monotonic()
        with self._lock:
            return {name: now - arrival for name, arrival in self._arrived.items()}

    @property
    def travelled(self) -> float:
        """Metres travelled, by the poses that came."""
        with self._lock:
            return self._travelled

    def take_odometry(self, odometry: Message, received: Received) -> None:
        """Take a nav_msgs/Odometry."""
        try:
            stamp, pose, velocity = pose_from(odometry)
        except RosError as error:
            self._health.refused_pose(received.time, str(error))
            raise
        self.velocity = velocity
        self._health.measured(received.time, *velocity)
        self._came("odometry", received)
        if self._config.sensing.pose == "odometry":
            floor = odometry.pose.pose.position.z - self._config.sensing.pose_height
            base = self._map.add_pose(stamp, pose, floor, odometry.header.frame_id, odometry.child_frame_id)
            if base is None:
                self._health.refused_pose(received.time, self._map.problem)
            else:
                self._moved(stamp, base, received)

    def take_transforms(self, transforms: Message, received: Received) -> None:
        """Take a tf2_msgs/TFMessage of /tf."""
        found = transforms_from(transforms)
        # Only a transform that moves the robot's own frame tells where it is now.
        stamp = self._map.add_transforms(found)
        self._came("tf", received)
        pose = None if stamp is None else self._map.pose
        if stamp is not None and pose is not None:
            self._moved(stamp, pose, received)
        if swing := self._map.swing:
            self._health.disagreed(received.time, swing)

    def take_static_transforms(self, transforms: Message, received: Received) -> None:
        """Take a tf2_msgs/TFMessage of /tf_static."""
        self._map.add_transforms(transforms_from(transforms), static=True)
        self._came("tf_static", received)

    def take_scan(self, scan: Message, received: Received) -> None:
        """Take a sensor_msgs/LaserScan; one that is not sound is no part of the map."""
        stamp = seconds(scan.header.stamp)
        try:
            read, strange = understood(scan_from(scan), self._config.sensing.no_return)
        except RosError as error:
            self._sensed("scan", received, scan, Fault(FaultKind.SENSOR_INVALID, str(error)))
            raise
        self._map.note(scan_note(scan))
        self._map.note(strange)
        fault = self._sight_of("scan", scan).scan(scan, read, self._map.pose, received.time)
        if fault is None or fault.kind is FaultKind.SENSOR_BLIND:
            sweep = sweep_of(scan) if self._config.sensing.deskew else 0.0
            self._map.add_scan(stamp, read, scan.header.frame_id, sweep)
        else:
            self._map.refuse(fault.kind.value, fault.reason)
        self._sensed("scan", received, scan, fault)

    def take_points(self, cloud: Message, received: Received) -> None:
        """Take a sensor_msgs/PointCloud2; one that is not sound is no part of the map."""
        stamp = seconds(cloud.header.stamp)
        try:
            points = points_from(cloud)
        except RosError as error:
            self._sensed("points", received, cloud, Fault(FaultKind.SENSOR_INVALID, str(error)))
            raise
        self._map.note(cloud_note(cloud))
        fault = self._sight_of("points", cloud).points(cloud, points, self._map.pose, received.time)
        if fault is None or fault.kind is FaultKind.SENSOR_BLIND:
            self._map.add_points(stamp, points, cloud.header.frame_id, self._times(cloud, points))
        else:
            self._map.refuse(fault.kind.value, fault.reason)
        self._sensed("points", received, cloud, fault)

    def take_grid(self, grid: Message, received: Received) -> None:
        """Take a nav_msgs/OccupancyGrid."""
        cells, resolution, origin = grid_from(grid)
        self._map.add_grid(seconds(grid.header.stamp), cells, resolution, origin, grid.header.frame_id)
        self._sensed("grid", received)

    def _moved(self, stamp: float, pose: Pose, received: Received) -> None:
        self.stamp = stamp
        self._health.heard_pose(received.time, stamp, pose)
        self._came("pose", received)
        with self._lock:
            last = self._last_position
            step = 0.0 if last is None else pose.distance_to(last)
            # Metres are added in steps of 0.2 m, so that noise of a standing robot is no way.
            if last is None or step >= 0.2:
                self._last_position = pose.position
                self._travelled += step

    def _times(self, cloud: Message, points: NDArray[np.float32]) -> NDArray[np.float64] | None:
        return times_from(cloud, points) if self._config.sensing.deskew else None

    def _sight_of(self, name: str, sent: Message) -> Sight:
        """Return what looks at the messages of a lidar: several share a topic, each with its own frame."""
        lidar = name, plain(sent.header.frame_id)
        if lidar not in self._sight and len(self._sight) >= MAX_LIDARS:
            lidar = name, ""
        if lidar not in self._sight:
            self._sight[lidar] = Sight(self._config.safety, self._config.sensing.range_min)
        return self._sight[lidar]

    def _sensed(self, name: str, received: Received, sent: Message | None = None, fault: Fault | None = None) -> None:
        self._came(name, received)
        source = name == self._config.sensing.source
        if sent is None:
            if source:
                self._health.heard_sensor(received.time)
            return
        stamp, frame = seconds(sent.header.stamp), plain(sent.header.frame_id)
        if source:
            self._health.heard_sensor(received.time, stamp, fault, frame)
        elif self._config.driving.enabled:
            # What is not the source of the map still shows the local planner its obstacles.
            self._health.heard_other(name, received.time, stamp, fault, frame)

    def _came(self, name: str, received: Received) -> None:
        with self._lock:
            self._arrived[name] = received.time
