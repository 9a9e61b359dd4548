"""A small robot on the bus: a point in the grid simulator that publishes scans and odometry and goes to waypoints."""

import contextlib
import json
import threading
import time
from math import atan2, cos, sin

from actors.simulators.grid import GridSimulator
from common.config import SimulatorConfig
from common.errors import SimulatorError
from common.geometry import Pose
from common.system.closing import Closing
from deploy.bridge.bridge import Bridge
from deploy.config import DeployConfig
from deploy.network_config import RosConfig
from deploy.ros2 import SENSOR, Node, message
from deploy.ros2.conversions import laser_scan, odometry, position_from, velocity_from
from tests.common.bus.processes import free_port
from tests.deploy.bridge.offline import MAPPING, settings

PERIOD = 0.1


def network(**sections) -> tuple[RosConfig, DeployConfig]:
    """Settings of a router and of a bridge that connects to it; sections as dictionaries."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    router = RosConfig(listen=(endpoint,), connect=(), node="fake_robot")
    base = {
        "ros": {"connect": [endpoint]},
        "mapping": MAPPING,
        "topics": {"stop": "/stop", "velocity": "/cmd_vel"},
        "sensing": {"range_noise": 0.0},
        "safety": {"scan_timeout": 3.0, "pose_timeout": 3.0},
    }
    merged = {name: {**base.get(name, {}), **sections.get(name, {})} for name in {*base, *sections}}
    return router, settings(**merged)


@contextlib.contextmanager
def running_bridge(config):
    """A bridge that decides in a thread, until the end of the `with` or its own; yields it and the thread."""
    stop = threading.Event()
    with Bridge(config) as bridge:
        thread = threading.Thread(target=bridge.run, args=(stop,), daemon=True)
        thread.start()
        try:
            yield bridge, thread
        finally:
            stop.set()
            thread.join(10.0)


class FakeRobot(Closing):
    """The robot, in a thread of its own; what it hears is kept in lists."""

    def __init__(self, world, router: RosConfig, speed: float = 2.0, *, by_velocity: bool = False):
        self.simulator = GridSimulator(SimulatorConfig(name="grid", rays=360), 10.0)
        self.pose = self.simulator.reset(world, 0)
        self.speed = speed
        self.by_velocity = by_velocity
        self.sensing = True
        self.jump = None
        self.spoil_scan = self.spoil_odometry = lambda message: message
        self.clock = 0.0
        self.driven = 0.0
        self.waypoint = None
        self.stopped = False
        self.velocities, self.stops, self.statuses, self.answers, self.waypoints = [], [], [], [], []
        self.heard = {}
        self._stop = threading.Event()
        self._moving = threading.Lock()
        self.node = Node(router)
        self._odometry = self.node.publisher("/odom", "nav_msgs/msg/Odometry")
        self._scan = self.node.publisher("/scan", "sensor_msgs/msg/LaserScan", SENSOR)
        self.commands = self.node.publisher("/hd/command", "std_msgs/msg/String")
        self.goals = self.node.publisher("/goal_point", "geometry_msgs/msg/PointStamped")
        self.starts = self.node.publisher("/start_exploration", "std_msgs/msg/Bool")
        self.emergency = self.node.publisher("/hd/emergency_stop", "std_msgs/msg/Bool")
        for topic, kind, take in (
            ("/way_point", "geometry_msgs/msg/PointStamped", self._aim),
            ("/stop", "std_msgs/msg/Int8", lambda m: self.stops.append((time.monotonic(), m.data))),
            (
                "/cmd_vel",
                "geometry_msgs/msg/Twist",
                lambda m: self.velocities.append((time.monotonic(), velocity_from(m))),
            ),
            ("/hd/status", "std_msgs/msg/String", lambda m: self.statuses.append(json.loads(m.data))),
            ("/hd/acknowledgement", "std_msgs/msg/String", lambda m: self.answers.append(json.loads(m.data))),
        ):
            self.node.subscribe(topic, kind, lambda m, how, take=take: take(m))
        for topic, kind in (
            ("/hd/path", "nav_msgs/msg/Path"),
            ("/hd/beacon", "geometry_msgs/msg/PointStamped"),
            ("/hd/markers", "visualization_msgs/msg/MarkerArray"),
            ("/hd/belief", "nav_msgs/msg/OccupancyGrid"),
            ("/runtime", "std_msgs/msg/Float32"),
            ("/traveling_distance", "std_msgs/msg/Float32"),
            ("/exploration_finish", "std_msgs/msg/Bool"),
        ):
            self.node.subscribe(topic, kind, lambda m, how, topic=topic: self.heard.__setitem__(topic, m))
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def carry_to(self, pose: Pose) -> None:
        """Put the robot somewhere else, to stand there until it hears a new waypoint."""
        with self._moving:
            self.waypoint = None
            self.simulator.place(pose)
            self.pose = pose

    def say(self, text: str) -> None:
        self.commands.publish(message("std_msgs/msg/String", data=text))

    @property
    def status(self) -> dict:
        return self.statuses[-1] if self.statuses else {}

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self.node.close()
        self.simulator.close()

    def _aim(self, point) -> None:
        self.waypoint = position_from(point)[1]
        self.waypoints.append(self.waypoint)

    def _run(self) -> None:
        while not self._stop.wait(PERIOD):
            with self._moving:
                velocity, pose, scan = self._move(), self.pose, self.simulator.scan()
            stamp = time.time() + self.clock
            if self.jump is not None:
                pose = Pose(pose.x + self.jump, pose.y, pose.yaw)
            if self.sensing:
                self._odometry.publish(self.spoil_odometry(odometry(stamp, "map", "base_link", pose, velocity)))
                self._scan.publish(self.spoil_scan(laser_scan(stamp, "base_link", scan)))

    def _move(self) -> tuple[float, float]:
        stopped = bool(self.stops) and self.stops[-1][1] > 0
        waypoint = self.waypoint
        if self.by_velocity:
            return self._roll()
        if waypoint is not None and not stopped:
            self._drive(waypoint, self.speed * PERIOD)
        return 0.0, 0.0

    def _drive(self, waypoint, length) -> None:
        yaw = atan2(waypoint[1] - self.pose.y, waypoint[0] - self.pose.x)
        length = min(length, self.pose.distance_to(waypoint))
        there = Pose(self.pose.x + length * cos(yaw), self.pose.y + length * sin(yaw), yaw)
        try:
            self.simulator.place(there)
        except SimulatorError:
            return
        self.driven += self.pose.distance_to(there.position)
        self.pose = there

    def _roll(self) -> tuple[float, float]:
        """Move by the last velocity, unless it is older than 0.5 s."""
        if not self.velocities or time.monotonic() - self.velocities[-1][0] > 0.5:
            return 0.0, 0.0
        linear, angular = self.velocities[-1][1]
        yaw = self.pose.yaw + angular * PERIOD
        self.pose = Pose(self.pose.x, self.pose.y, yaw)
        ahead = (self.pose.x + 10.0 * cos(yaw), self.pose.y + 10.0 * sin(yaw))
        self._drive(ahead, linear * PERIOD)
        return linear, angular
