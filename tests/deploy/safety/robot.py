"""A robot on a real bus for the tests of the watchdog, and a bridge in a process of its own."""

import contextlib
import json
import threading
import time

import numpy as np

from common.geometry import Pose
from deploy.config import DeployConfig
from deploy.ros2 import LATCHED, SENSOR, Node, header, message
from deploy.ros2.conversions import odometry
from deploy.safety.gate import behind_watchdog
from tests.common.bus.processes import free_port, python

ZERO = (0.0, 0.0)


def configuration(**changes) -> DeployConfig:
    """Short timeouts, a free port; `changes` go below their section: safety={...}."""
    port = free_port()
    tree = {
        "ros": {"connect": (f"tcp/127.0.0.1:{port}",)},
        "driving": {"enabled": True},
        "topics": {"stop": "/stop"},
        "safety": {
            "scan_timeout": 0.4,
            "pose_timeout": 0.4,
            "bridge_timeout": 0.3,
            "zero_for": 1.0,
            "joy_release": 0.5,
        },
    }
    for section, values in changes.items():
        tree[section] = tree.get(section, {}) | values
    return DeployConfig(**tree)


class Robot(contextlib.ExitStack):
    """Publishes scans and odometry at 50 Hz, and keeps every velocity and stop that arrives with its time."""

    def __init__(self, config: DeployConfig) -> None:
        super().__init__()
        self.config = config
        self.velocities: list[tuple[float, tuple[float, float]]] = []
        self.stops: list[tuple[float, int]] = []
        self.status: list[dict] = []
        self.stamps: list[float] = []
        self.scanning = self.posing = True
        self.position = (0.0, 0.0)
        self._end = threading.Event()

    def __enter__(self):
        super().__enter__()
        config, topics = self.config, self.config.topics
        ros = config.ros
        # Without a router of its own, the robot connects to the bridge's side.
        ros = behind_watchdog(ros) if ros.listen else ros.model_copy(update={"listen": ros.connect, "connect": ()})
        node = self.enter_context(Node(ros, "robot"))
        if topics.velocity:
            node.subscribe(topics.velocity, f"geometry_msgs/msg/{config.driving.message}", self._moved)
        if topics.stop:
            node.subscribe(topics.stop, "std_msgs/msg/Int8", lambda one, how: self.stops.append((how.time, one.data)))
        node.subscribe(
            topics.watchdog,
            "std_msgs/msg/String",
            lambda one, how: self.status.append(json.loads(one.data)),
            LATCHED,
        )
        self._scan = node.publisher(topics.scan or "/scan", "sensor_msgs/msg/LaserScan", SENSOR)
        self._cloud = node.publisher(topics.points or "/points", "sensor_msgs/msg/PointCloud2", SENSOR)
        self._pose = node.publisher(topics.odometry, "nav_msgs/msg/Odometry", SENSOR)
        self._tf = node.publisher(topics.tf or "/tf", "tf2_msgs/msg/TFMessage")
        self._joy = node.publisher(topics.joy, "sensor_msgs/msg/Joy")
        self._emergency_stop = node.publisher(topics.emergency_stop, "std_msgs/msg/Bool")
        thread = threading.Thread(target=self._publish)
        thread.start()
        self.callback(thread.join)
        self.callback(self._end.set)
        return self

    def emergency_stop(self, pressed: bool = True) -> float:
        now = time.monotonic()
        self._emergency_stop.publish(message("std_msgs/msg/Bool", data=pressed))
        return now

    def joystick(self, *axes: float) -> float:
        now = time.monotonic()
        self._joy.publish(message("sensor_msgs/msg/Joy", axes=np.array(axes, np.float32)))
        return now

    def velocity(self) -> tuple[float, float] | None:
        return self.velocities[-1][1] if self.velocities else None

    def time_to_zero(self, since: float, timeout: float = 3.0) -> float:
        """Seconds from `since` to the first zero velocity after which nothing but zeros came for 0.2 s."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            later = [(when, value) for when, value in list(self.velocities) if when >= since]
            last = max((i for i, (_, value) in enumerate(later) if value != ZERO), default=-1)
            if len(later) > last + 1 and time.monotonic() - later[last + 1][0] > 0.2:
                return later[last + 1][0] - since
            time.sleep(0.01)
        raise AssertionError(f"no zero velocity within {timeout} s; last {self.velocities[-5:]}")

    def _moved(self, twist, received) -> None:
        if self.config.driving.message == "TwistStamped":
            self.stamps.append(twist.header.stamp.sec + twist.header.stamp.nanosec * 1e-9)
            twist = twist.twist
        self.velocities.append((received.time, (twist.linear.x, twist.angular.z)))

    def _publish(self) -> None:
        scan = message("sensor_msgs/msg/LaserScan", header=header(1000.0, "base_link"), ranges=[1.0] * 360)
        cloud = message("sensor_msgs/msg/PointCloud2", header=header(1000.0, "map"), data=np.zeros(48000, np.uint8))
        base = message("geometry_msgs/msg/TransformStamped", child_frame_id="base_link")
        slam = message("geometry_msgs/msg/TransformStamped", child_frame_id="odom")
        tf = {True: message("tf2_msgs/msg/TFMessage", transforms=[slam, base])}
        tf[False] = message("tf2_msgs/msg/TFMessage", transforms=[slam])
        while not self._end.wait(0.02):
            if self.scanning:
                self._scan.publish(scan)
                self._cloud.publish(cloud)
            if self.posing:
                self._pose.publish(odometry(1000.0, "map", "base_link", Pose(*self.position)))
            self._tf.publish(tf[self.posing])


BRIDGE = """
import json, logging, sys, threading
from common.system.logs import setup_logging
from deploy.config import DeployConfig
from deploy.ros2 import Node
from deploy.safety.gate import VelocityGate, behind_watchdog

setup_logging("info")
config = DeployConfig.model_validate_json(sys.argv[1])
command = [1.0, 0.2]
def work():
    while not ended.wait(0.05):
        if command is not None:
            gate.command(*command)
ended = threading.Event()
with VelocityGate(config) as gate, Node(behind_watchdog(config.ros)) as node:
    gate.use_when_watchdog_dies(node)
    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    print(json.dumps({"pid": gate.pid}), flush=True)
    for line in sys.stdin:
        name, *arguments = json.loads(line)
        if name == "command":
            command = arguments or None
        elif name == "state":
            state = gate.state
            print(json.dumps({"mode": state.mode, "clear": state.clear, "alive": state.alive, "pid": gate.pid,
                              "reason": state.reason}), flush=True)
        elif name == "end":
            ended.set()
            thread.join()
            break
        else:
            getattr(gate, name)(*arguments)
"""


class Bridge:
    """A bridge in a process of its own, whose gate is told by lines what to do."""

    def __init__(self, process) -> None:
        self.process = process
        self.pid = process.pid
        self.watchdog = json.loads(process.stdout.readline())["pid"]

    def tell(self, *line) -> float:
        now = time.monotonic()
        self.process.stdin.write(json.dumps(line) + "\n")
        self.process.stdin.flush()
        return now

    def state(self) -> dict:
        self.tell("state")
        return json.loads(self.process.stdout.readline())


@contextlib.contextmanager
def bridge(config: DeployConfig):
    with python(BRIDGE, config.model_dump_json()) as process:
        yield Bridge(process)
