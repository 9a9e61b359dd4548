"""The robot of the soak: simulated physics behind real topics, whose messages and links can be spoilt."""

from __future__ import annotations

import itertools
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from actors.maps.clear_space import clear_space
from actors.maps.connectivity import reachable
from actors.maps.grid_map import GridMap
from common.planners.base import Position
from common.system.closing import Closing
from deploy.config import DeployConfig
from deploy.robot.interface import RobotInterface
from deploy.robot.options import RobotOptions
from deploy.robot.pace import Pace
from deploy.robot.simulation import SimulatedRobot
from deploy.ros2 import RELIABLE, Message, Node, Publisher, QoS, seconds, stamp
from deploy.ros2.endpoints import Subscription

SCAN = "sensor_msgs/msg/LaserScan"
ODOMETRY = "nav_msgs/msg/Odometry"
# What counts as standing, m/s and rad/s: contact solvers never bring wheels to rest to the last digit.
STANDING_SPEED = 0.03
STANDING_TURN = 0.05

Spoil = Callable[[Message], Message | None]


class SpoiltNode:
    """A node whose messages are changed or lost on their way out; it takes the place of a `Node`.

    Attributes:
        spoil: what becomes of the messages of a type; None for one that is lost.
        clock: what is added to every stamp, seconds.
    """

    def __init__(self, node: Node) -> None:
        """Send by a node."""
        self._node = node
        self.spoil: dict[str, Spoil] = {}
        self.clock = 0.0

    def publisher(self, topic: str, kind: str, qos: QoS = RELIABLE) -> Publisher:
        """Declare a publisher whose messages are spoilt."""
        return cast(Publisher, _SpoiltPublisher(self._node.publisher(topic, kind, qos), kind, self))

    def subscribe(self, *arguments: Any, **named: Any) -> Subscription:
        """Listen, as `Node.subscribe` does."""
        return self._node.subscribe(*arguments, **named)


class _SpoiltPublisher:
    def __init__(self, publisher: Publisher, kind: str, node: SpoiltNode) -> None:
        self._publisher, self._kind, self._node = publisher, kind, node

    def publish(self, sent: Message) -> None:
        spoil = self._node.spoil.get(self._kind)
        if self._node.clock:
            for one in getattr(sent, "transforms", [sent]):
                if hasattr(one, "header"):
                    one.header.stamp = stamp(seconds(one.header.stamp) + self._node.clock)
        spoilt = sent if spoil is None else spoil(sent)
        if spoilt is not None:
            self._publisher.publish(spoilt)


@dataclass(frozen=True, slots=True)
class Motion:
    """The true motion at a moment: time (monotonic, s), way so far (m), speed (m/s) and turn rate (rad/s)."""

    time: float
    distance: float
    speed: float
    turn_rate: float

    @property
    def stands(self) -> bool:
        """Whether the robot stands."""
        return abs(self.speed) < STANDING_SPEED and abs(self.turn_rate) < STANDING_TURN


class SoakRobot(Closing):
    """A simulated robot that lives in a thread of this process.

    Attributes:
        node: its messages can be spoilt here.
        places: (x, y) of clear places far from each other, map frame, metres.
    """

    def __init__(self, options: RobotOptions, config: DeployConfig, node: Node) -> None:
        """Put the robot into its world and let it live."""
        self._robot = SimulatedRobot(options, config)
        self.node = SpoiltNode(node)
        self.places = far_places(self._robot.world, config.mapping.robot_radius + 0.3)
        self._motions: deque[Motion] = deque(maxlen=20_000)
        self._pace = Pace(options.speed_factor)
        self._stop = threading.Event()
        self._interface = RobotInterface(cast(Node, self.node), self._robot, config)
        self._thread = threading.Thread(target=self._live, name="robot", daemon=True)
        self._thread.start()

    @property
    def collisions(self) -> int:
        """Contacts with walls so far."""
        return self._robot.collisions

    @property
    def real_time_factor(self) -> float:
        """Seconds of the robot per second."""
        return self._pace.reached

    @property
    def motion(self) -> Motion:
        """The newest one."""
        return self._motions[-1]

    @property
    def lives(self) -> bool:
        """Whether the simulation runs."""
        return self._thread.is_alive()

    def since(self, moment: float) -> list[Motion]:
        """Return the motions after a moment, oldest first."""
        newest_first = itertools.takewhile(lambda motion: motion.time >= moment, reversed(self._motions.copy()))
        return list(newest_first)[::-1]

    def close(self) -> None:
        """End the simulation; safe to call twice."""
        self._stop.set()
        self._thread.join()
        self._robot.close()

    def _live(self) -> None:
        while not self._stop.is_set():
            moment = self._robot.step(time.monotonic())
            self._motions.append(Motion(time.monotonic(), self._robot.distance, *moment.velocity))
            self._interface.publish(moment, self._pace.reached)
            self._pace.wait(self._robot.time, self._stop)


def far_places(world: GridMap, radius: float, count: int = 6) -> list[Position]:
    """Return clear places that the robot can get to, each as far as may be from those before it and from the start."""
    clear, start = clear_space(world, radius)
    cells = np.argwhere(reachable(clear, start))
    chosen = [start]
    for _ in range(count):
        away = np.min([np.hypot(*(cells - place).T) for place in chosen], axis=0)
        row, column = cells[int(np.argmax(away))]
        chosen.append((int(row), int(column)))
    return [
        (world.origin[0] + (column + 0.5) * world.resolution, world.origin[1] + (row + 0.5) * world.resolution)
        for row, column in chosen[1:]
    ]


def way(motions: list[Motion]) -> float:
    """Return the metres driven over some motions."""
    return motions[-1].distance - motions[0].distance if motions else 0.0


def standstill(motions: list[Motion], steady: float = 0.3) -> Motion | None:
    """Return the first motion from which on the robot stands for at least ``steady`` seconds; None without one."""
    first: Motion | None = None
    for motion in motions:
        first = (first or motion) if motion.stands else None
        if first is not None and motion.time - first.time >= steady:
            return first
    return None
