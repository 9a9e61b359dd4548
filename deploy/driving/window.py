"""The dynamic window: velocities that the robot can reach, and the choice among them.

After Fox, Burgard and Thrun, "The dynamic window approach to collision avoidance", IEEE RAM 1997: only velocities count
from which the robot can brake before every obstacle. Here the whole manoeuvre of braking is rolled out, with the delay
of the drive (`deploy.driving.rollout`).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, hypot, sin
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from deploy.config import DrivingConfig
from deploy.driving.costmap import LocalCostmap, Points
from deploy.driving.rollout import LAG, Body, can_brake, gaps, judge
from deploy.outline import edges_of

Velocity = tuple[float, float]

REACTION: Final = 0.1
"""A command may stand for so much longer than one interval: age of the pose, a late successor; seconds."""


@dataclass(frozen=True, slots=True)
class Motion:
    """Where the robot is and how it moves.

    Attributes:
        pose: map frame.
        velocity: measured, (m/s, rad/s).
        base: last command, from which the next may differ by what the acceleration limits allow.
        interval: seconds until the next command.
    """

    pose: Pose
    velocity: Velocity
    base: Velocity
    interval: float


class DynamicWindow:
    """Chooses velocities for one robot."""

    def __init__(self, config: DrivingConfig) -> None:
        self._config = config
        self._turns = np.linspace(-config.max_turn_rate, config.max_turn_rate, 15)
        self._points: Points = np.empty((0, 2))
        self._rooms: NDArray[np.float64] = np.empty(0)
        self._body = _body_of(config)
        self._costmap: LocalCostmap | None = None

    def look(self, costmap: LocalCostmap, motion: Motion, lookahead: float) -> None:
        """Gather the obstacles that count for the next choice, and how near each may come.

        An obstacle that is nearer than the room that is kept, because it appeared or the pose is uncertain, may come
        no nearer.
        """
        config = self._config
        speed = max(abs(motion.velocity[0]), abs(motion.base[0])) + config.max_acceleration * motion.interval
        braking = speed * (motion.interval + REACTION + 3.0 * LAG) + speed**2 / (2.0 * config.max_acceleration)
        reach = max(braking, lookahead + 0.2) + max(costmap.field.cap, config.reach + config.clearance)
        self._points, distances = costmap.near(motion.pose.x, motion.pose.y, reach)
        self._rooms = np.minimum(costmap.room, distances)
        outside = gaps(motion.pose.x, motion.pose.y, motion.pose.yaw, self._points, self._body)
        self._body = self._body._replace(rooms=np.minimum(config.clearance, outside))
        self._costmap = costmap

    def step(self, motion: Motion, target: Velocity) -> Velocity:
        """Return the command that comes nearest to a target velocity within the acceleration limits."""
        config = self._config
        change, turn = config.max_acceleration * motion.interval, config.max_turn_acceleration * motion.interval
        linear = min(max(target[0], motion.base[0] - change), motion.base[0] + change)
        angular = min(max(target[1], motion.base[1] - turn), motion.base[1] + turn)
        return (
            min(max(linear, -config.max_speed), config.max_speed),
            min(max(angular, -config.max_turn_rate), config.max_turn_rate),
        )

    def safe(self, motion: Motion, command: Velocity) -> bool:
        """Whether the robot can still brake before every obstacle after this command."""
        costmap = self._looked()
        config = self._config
        return bool(
            can_brake(
                motion.pose.x,
                motion.pose.y,
                motion.pose.yaw,
                *motion.velocity,
                *command,
                config.max_acceleration,
                config.max_turn_acceleration,
                motion.interval + REACTION,
                self._points,
                self._rooms,
                costmap.field,
                self._body,
            )
        )

    def choose(
        self, motion: Motion, carrot: tuple[float, float], speed: float, previous_turn: float
    ) -> tuple[Velocity, float] | None:
        """Choose the command that serves best to reach a point.

        Args:
            motion: of this moment.
            carrot: (x, y) to head for, metres.
            speed: desired, m/s.
            previous_turn: turn rate that was aimed at before, rad/s.

        Returns:
            The command and the turn rate aimed at, or None when no forward command is safe.
        """
        costmap = self._looked()
        config = self._config
        speeds = np.unique(np.array([0.0, 0.15, 0.3, 0.5, 0.75, 1.0]) * speed)
        dx, dy = carrot[0] - motion.pose.x, carrot[1] - motion.pose.y
        gap = max(hypot(dx, dy), 1e-6)
        # Pure pursuit's curvature (Coulter, 1992) is a sample as well: in free space nothing is better.
        curvature = 2.0 * sin(atan2(dy, dx) - motion.pose.yaw) / gap
        samples = [(v, w) for v in speeds for w in self._turns]
        samples += [(v, max(-config.max_turn_rate, min(config.max_turn_rate, v * curvature))) for v in speeds]
        targets = np.array(samples)
        commands = np.array([self.step(motion, (v, w)) for v, w in samples])
        costs = judge(
            motion.pose.x,
            motion.pose.y,
            motion.pose.yaw,
            *motion.velocity,
            commands,
            targets,
            config.max_acceleration,
            config.max_turn_acceleration,
            motion.interval + REACTION,
            *carrot,
            gap,
            speed,
            config.max_turn_rate,
            previous_turn,
            costmap.room,
            self._points,
            self._rooms,
            costmap.field,
            self._body,
        )
        best = int(np.argmin(costs))
        if not np.isfinite(costs[best]):
            return None
        return (float(commands[best, 0]), float(commands[best, 1])), float(targets[best, 1])

    def _looked(self) -> LocalCostmap:
        if self._costmap is None:
            raise RuntimeError("call look() before choosing a velocity")
        return self._costmap


def _body_of(config: DrivingConfig) -> Body:
    edges = np.array(edges_of(config.footprint) if config.footprint else [], np.float64).reshape(-1, 3)
    return Body(edges, np.empty(0), config.reach + config.clearance)
