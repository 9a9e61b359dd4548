"""The dynamic window: velocities that the robot can reach, rolled out, judged and chosen from.

After Fox, Burgard and Thrun, "The dynamic window approach to collision avoidance", IEEE RAM 1997: only velocities count
from which the robot can brake before every obstacle. Here the whole manoeuvre of braking is rolled out, with the delay
of the drive, and checked against every obstacle point with the robot's circle, and its outline where it has one.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, exp, hypot, pi, sin
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from common.system.jit import njit
from deploy.config import DrivingConfig
from deploy.driving.costmap import Field, LocalCostmap, Points, lookup
from deploy.outline import edges_of

Velocity = tuple[float, float]

LAG: Final = 0.1
"""Time constant with which wheels follow commands, seconds."""
REACTION: Final = 0.1
"""A command may stand for so much longer than one interval: age of the pose, a late successor; seconds."""
_BRAKE_STEP: Final = 0.05
_HORIZON_STEP: Final = 0.1
_HORIZON: Final = 1.6
# Weights of the terms in `_judge`.
_DISTANCE, _HEADING, _CLEARANCE, _SPEED, _COLLISION, _STEADY = 1.0, 0.5, 0.35, 0.5, 3.0, 0.05
_TOLERANCE: Final = 1e-3


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


class Body(NamedTuple):
    """The robot's outline; kernels take it as it is.

    Attributes:
        edges: shape (n, 3): outward normal and distance from the centre of each edge; empty for a round robot.
        rooms: for each obstacle point, how near to the outline it may come, metres.
        reach: points farther from the centre are no matter, metres.
    """

    edges: NDArray[np.float64]
    rooms: NDArray[np.float64]
    reach: float


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
        gaps = _gaps(motion.pose.x, motion.pose.y, motion.pose.yaw, self._points, self._body)
        self._body = self._body._replace(rooms=np.minimum(config.clearance, gaps))
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
            _can_brake(
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
        costs = _judge(
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


@njit(cache=True, nogil=True)
def _toward(value: float, target: float, change: float) -> float:
    return min(max(target, value - change), value + change)


@njit(cache=True, nogil=True)
def _room_left(x: float, y: float, points: Points, rooms: NDArray[np.float64], field: Field) -> tuple[float, float]:
    """Return how much nearer obstacles may come, and the distance of the nearest, metres; no more than `cap`."""
    cap = field.cap
    # A position is at most 0.71 cells away from its cell's centre.
    if lookup(field, x, y) >= cap:
        return cap, cap - 0.71 * field.resolution
    nearest, least = cap * cap, cap
    for index in range(len(points)):
        dx, dy = points[index, 0] - x, points[index, 1] - y
        square = dx * dx + dy * dy
        if square < cap * cap:
            nearest = min(nearest, square)
            least = min(least, np.sqrt(square) - rooms[index])
    return least, np.sqrt(nearest)


@njit(cache=True, nogil=True)
def _gap(cosine: float, sine: float, px: float, py: float, edges: NDArray[np.float64]) -> float:
    """Return how far a point is outside of the outline, metres, negative inside; less than that before a corner."""
    along, across = px * cosine + py * sine, py * cosine - px * sine
    gap = -np.inf
    for edge in range(len(edges)):
        gap = max(gap, edges[edge, 0] * along + edges[edge, 1] * across - edges[edge, 2])
    return gap


@njit(cache=True, nogil=True)
def _gaps(x: float, y: float, yaw: float, points: Points, body: Body) -> NDArray[np.float64]:
    gaps = np.empty(len(points) if len(body.edges) else 0)
    for index in range(len(gaps)):
        gaps[index] = _gap(cos(yaw), sin(yaw), points[index, 0] - x, points[index, 1] - y, body.edges)
    return gaps


@njit(cache=True, nogil=True)
def _hits(x: float, y: float, yaw: float, points: Points, body: Body) -> bool:
    """Whether a point is nearer to the outline than it may come."""
    if len(body.edges) == 0:
        return False
    cosine, sine = cos(yaw), sin(yaw)
    for index in range(len(points)):
        px, py = points[index, 0] - x, points[index, 1] - y
        if px * px + py * py > body.reach * body.reach:
            continue
        if _gap(cosine, sine, px, py, body.edges) < body.rooms[index] - _TOLERANCE:
            return True
    return False


@njit(cache=True, nogil=True)
def _can_brake(
    x: float,
    y: float,
    yaw: float,
    linear: float,
    angular: float,
    command: float,
    turn: float,
    acceleration: float,
    turn_acceleration: float,
    hold: float,
    points: Points,
    rooms: NDArray[np.float64],
    field: Field,
    body: Body,
) -> bool:
    """Roll a command out for `hold` seconds, then brake to a stand; False when an obstacle comes too near."""
    step = _BRAKE_STEP
    follow = 1.0 - exp(-step / LAG)
    time = 0.0
    while time < 20.0:
        if time >= hold:
            command = _toward(command, 0.0, acceleration * step)
            turn = _toward(turn, 0.0, turn_acceleration * step)
        linear += (command - linear) * follow
        angular += (turn - angular) * follow
        yaw += 0.5 * angular * step
        x += linear * cos(yaw) * step
        y += linear * sin(yaw) * step
        yaw += 0.5 * angular * step
        time += step
        room, _ = _room_left(x, y, points, rooms, field)
        if room < -_TOLERANCE or _hits(x, y, yaw, points, body):
            return False
        # A circle that turns sweeps nothing.
        turning = len(body.edges) > 0 and (turn != 0.0 or abs(angular) > 0.02)
        if command == 0.0 and abs(linear) < 0.01 and not turning:
            return True
    return False


@njit(cache=True, nogil=True)
def _judge(
    x0: float,
    y0: float,
    yaw0: float,
    linear0: float,
    angular0: float,
    commands: NDArray[np.float64],
    targets: NDArray[np.float64],
    acceleration: float,
    turn_acceleration: float,
    hold: float,
    carrot_x: float,
    carrot_y: float,
    gap: float,
    speed: float,
    max_turn: float,
    previous_turn: float,
    wanted_room: float,
    points: Points,
    rooms: NDArray[np.float64],
    field: Field,
    body: Body,
) -> NDArray[np.float64]:
    """Return the cost of every sample; infinite where the robot could not brake after its first command."""
    costs = np.full(len(targets), np.inf)
    step = _HORIZON_STEP
    follow = 1.0 - exp(-step / LAG)
    for sample in range(len(targets)):
        command, turn = commands[sample, 0], commands[sample, 1]
        if command < 0.0 or not _can_brake(
            x0, y0, yaw0, linear0, angular0, command, turn, acceleration, turn_acceleration, hold,
            points, rooms, field, body,
        ):  # fmt: skip
            continue
        x, y, yaw, linear, angular = x0, y0, yaw0, linear0, angular0
        time, travelled, least, collision = 0.0, 0.0, field.cap, 0.0
        while time < _HORIZON and travelled < gap:
            command = _toward(command, targets[sample, 0], acceleration * step)
            turn = _toward(turn, targets[sample, 1], turn_acceleration * step)
            linear += (command - linear) * follow
            angular += (turn - angular) * follow
            yaw += 0.5 * angular * step
            x += linear * cos(yaw) * step
            y += linear * sin(yaw) * step
            yaw += 0.5 * angular * step
            travelled += abs(linear) * step
            time += step
            room, nearest = _room_left(x, y, points, rooms, field)
            least = min(least, nearest)
            if room < -_TOLERANCE or _hits(x, y, yaw, points, body):
                collision = 1.0 - time / (2.0 * _HORIZON)
                break
        dx, dy = carrot_x - x, carrot_y - y
        distance = hypot(dx, dy)
        error = 0.0
        if distance > 0.1:
            error = abs((atan2(dy, dx) - yaw + pi) % (2.0 * pi) - pi) / pi
        tight = 1.0 - min(max((least - wanted_room) / (field.cap - wanted_room), 0.0), 1.0)
        costs[sample] = (
            _DISTANCE * distance / gap
            + _HEADING * error * min(1.0, distance / 0.3)
            + _CLEARANCE * tight * tight
            + _SPEED * (1.0 - targets[sample, 0] / max(speed, 1e-6))
            + _COLLISION * collision
            + _STEADY * abs(targets[sample, 1] - previous_turn) / max_turn
        )
    return costs
