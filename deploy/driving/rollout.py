"""Manoeuvres of the robot rolled out among obstacles: whether it can still brake, and what each costs.

A manoeuvre moves as the drive does, with its delay, and is checked against every obstacle point with the robot's
circle, and its outline where it has one.
"""

from __future__ import annotations

from math import atan2, cos, exp, hypot, pi, sin
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.system.jit import njit
from deploy.driving.costmap import Field, Points, lookup

LAG: Final = 0.1
"""Time constant with which wheels follow commands, seconds."""
_BRAKE_STEP: Final = 0.05
_HORIZON_STEP: Final = 0.1
_HORIZON: Final = 1.6
# Weights of the terms in `judge`.
_DISTANCE, _HEADING, _CLEARANCE, _SPEED, _COLLISION, _STEADY = 1.0, 0.5, 0.35, 0.5, 3.0, 0.05
_TOLERANCE: Final = 1e-3


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
def gaps(x: float, y: float, yaw: float, points: Points, body: Body) -> NDArray[np.float64]:
    """Return how far each point is outside of the outline, metres; empty for a round robot."""
    found = np.empty(len(points) if len(body.edges) else 0)
    for index in range(len(found)):
        found[index] = _gap(cos(yaw), sin(yaw), points[index, 0] - x, points[index, 1] - y, body.edges)
    return found


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
def can_brake(
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
def judge(
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
        if command < 0.0 or not can_brake(
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
