"""The topics of the simulated robot: those that a bridge of the same profile listens and speaks to."""

from __future__ import annotations

import functools
import json
import logging
import time
from collections.abc import Callable

from common.geometry import Pose
from deploy.config import DeployConfig
from deploy.robot.delay import DelayLine
from deploy.robot.follower import WaypointFollower
from deploy.robot.simulation import Moment, SimulatedRobot
from deploy.ros2 import LATCHED, RELIABLE, Message, Node, Publisher, QoS, Received, RosError, message, stamp
from deploy.ros2.conversions import (
    laser_scan,
    occupancy_grid,
    odometry,
    point_cloud,
    pose_from_stamped,
    position_from,
    transform,
    transform_message,
    velocity_from,
)

log = logging.getLogger(__name__)

CLOCK_TOPIC = "/clock"
TRUTH_TOPIC = "/hd/simulation"
"""std_msgs/String: JSON of what only a simulation knows: true pose, collisions, distance, speed of the simulation."""
LIDAR_FRAME = "laser"


class RobotInterface:
    """Publishes what the robot's sensors tell, and gives it the commands that come.

    Usage::

        interface = RobotInterface(node, robot, config)
        while True:
            interface.publish(robot.step(time.monotonic()), pace.reached)
    """

    def __init__(self, node: Node, robot: SimulatedRobot, config: DeployConfig) -> None:
        """Declare all topics; an empty name is a topic that the robot does not have.

        Args:
            node: joined to the network.
            robot: the robot behind the topics.
            config: names of topics and frames.
        """
        self._node = node
        self._robot = robot
        self._config = config
        self._epoch = time.time()
        self._delay = DelayLine(robot.options.sensor_latency)
        # What a pose is told of stands this high above the floor: on the CMU stack that is the lidar.
        self._height = config.sensing.pose_height
        topics = config.topics
        self._clock = self._publisher(CLOCK_TOPIC, "rosgraph_msgs/msg/Clock")
        self._truth = self._publisher(TRUTH_TOPIC, "std_msgs/msg/String")
        self._odometry = self._publisher(topics.odometry, "nav_msgs/msg/Odometry")
        self._scan = self._publisher(topics.scan, "sensor_msgs/msg/LaserScan")
        self._points = self._publisher(topics.points, "sensor_msgs/msg/PointCloud2")
        self._map = self._publisher(topics.map, "nav_msgs/msg/OccupancyGrid", LATCHED)
        self._tf = self._publisher(topics.tf, "tf2_msgs/msg/TFMessage")
        self._tf_static = self._publisher(topics.tf_static, "tf2_msgs/msg/TFMessage", LATCHED)
        self._listen()
        if self._tf_static is not None:
            above = robot.lidar_height - self._height
            mount = transform(self._epoch, config.frames.base, LIDAR_FRAME, Pose(0.0, 0.0), above)
            self._tf_static.publish(transform_message([mount]))

    def publish(self, moment: Moment, speed: float) -> None:
        """Publish what is due of a moment, after the latency of the sensors.

        Args:
            moment: the newest one.
            speed: simulated seconds per second that the simulation reaches.
        """
        self._delay.add(moment.time, functools.partial(self._send, moment, speed))
        self._delay.advance(moment.time)

    def _send(self, moment: Moment, speed: float) -> None:
        now = self._epoch + moment.time
        frames = self._config.frames
        if moment.odometry_due:
            _publish(self._clock, lambda: message("rosgraph_msgs/msg/Clock", clock=stamp(now)))
            _publish(self._tf, lambda: self._transforms(now, moment))
            _publish(self._odometry, lambda: self._odometry_message(now, moment))
        if moment.scan is not None:
            scan, period = moment.scan, 1.0 / self._robot.options.scan_rate
            _publish(self._scan, lambda: laser_scan(now, LIDAR_FRAME, scan, period))
            _publish(self._truth, lambda: message("std_msgs/msg/String", data=self._truth_text(moment, speed)))
        if moment.cloud is not None:
            cloud = moment.cloud
            frame = frames.map if self._config.sensing.points_frame == "map" else LIDAR_FRAME
            _publish(self._points, lambda: point_cloud(now, frame, cloud))
        if moment.grid is not None:
            grid = moment.grid
            _publish(self._map, lambda: occupancy_grid(now, frames.map, grid.cells, grid.resolution, grid.origin))

    def _odometry_message(self, now: float, moment: Moment) -> Message:
        frames = self._config.frames
        in_map = self._config.sensing.pose == "odometry"
        return odometry(
            now,
            frames.map if in_map else frames.odom,
            frames.base,
            moment.estimate if in_map else moment.odometry,
            moment.velocity,
            self._height,
        )

    def _transforms(self, now: float, moment: Moment) -> Message:
        frames = self._config.frames
        return transform_message(
            [
                transform(now, frames.map, frames.odom, Pose(*moment.correction)),
                transform(now, frames.odom, frames.base, moment.odometry, self._height),
            ]
        )

    def _truth_text(self, moment: Moment, speed: float) -> str:
        robot = self._robot
        target = robot.world.target
        people = [] if robot.people is None else robot.people.positions
        return json.dumps(
            {
                "time": round(moment.time, 4),
                "x": round(moment.truth.x, 4),
                "y": round(moment.truth.y, 4),
                "yaw": round(moment.truth.yaw, 4),
                "speed": round(moment.velocity[0], 4),
                "turn_rate": round(moment.velocity[1], 4),
                "distance": round(robot.distance, 3),
                "collisions": robot.collisions,
                "refused_commands": robot.base.refused,
                "people": [[round(x, 3), round(y, 3)] for x, y in people],
                "target": None if target is None else [round(target[0], 3), round(target[1], 3)],
                "real_time_factor": round(speed, 3),
            }
        )

    def _listen(self) -> None:
        topics, driving = self._config.topics, self._config.driving
        follower = self._robot.follower
        if follower is None:
            self._subscribe(topics.velocity, f"geometry_msgs/msg/{driving.message}", self._take_velocity)
            return
        self._subscribe(topics.waypoint, "geometry_msgs/msg/PointStamped", lambda m: follower.aim(position_from(m)[1]))
        self._subscribe(
            topics.waypoint_pose,
            "geometry_msgs/msg/PoseStamped",
            lambda m: follower.aim(pose_from_stamped(m)[1].position),
        )
        self._subscribe(topics.stop, "std_msgs/msg/Int8", lambda m: follower.stop(int(m.data)))
        self._subscribe(topics.speed, "std_msgs/msg/Float32", lambda m: follower.limit(float(m.data)))
        self._stop_by_velocity(follower)

    def _stop_by_velocity(self, follower: WaypointFollower) -> None:
        """Let zeros on the velocity topic hold the robot, as a velocity multiplexer before its base would."""

        def take(command: Message) -> None:
            if velocity_from(command) == (0.0, 0.0):
                follower.hold(time.monotonic())

        self._subscribe(self._config.topics.velocity, f"geometry_msgs/msg/{self._config.driving.message}", take)

    def _take_velocity(self, command: Message) -> None:
        robot = self._robot
        try:
            speed, turn_rate = velocity_from(command)
        except RosError:
            robot.base.refused += 1
            return
        robot.base.receive(speed, turn_rate, time.monotonic(), robot.time + robot.options.command_latency)

    def _subscribe(self, topic: str, kind: str, take: Callable[[Message], None]) -> None:
        def callback(received: Message, how: Received) -> None:
            del how
            take(received)

        if topic:
            self._node.subscribe(topic, kind, callback)

    def _publisher(self, topic: str, kind: str, qos: QoS = RELIABLE) -> Publisher | None:
        return self._node.publisher(topic, kind, qos) if topic else None


def _publish(publisher: Publisher | None, make: Callable[[], Message]) -> None:
    if publisher is not None:
        publisher.publish(make())
