"""Tracking of a straight segment by a differential-drive robot: turn towards it, then pure pursuit along it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from common.geometry import Pose


@dataclass(frozen=True, slots=True)
class DriveLimits:
    """What the drive may do.

    Attributes:
        speed: along the segment, m/s.
        acceleration: m/s².
        deceleration: m/s².
        turn_rate: rad/s.
        turn_acceleration: rad/s².
        tolerance: how near the goal counts as there, metres.
    """

    speed: float
    acceleration: float = 2.0
    deceleration: float = 2.0
    turn_rate: float = 3.0
    turn_acceleration: float = 9.0
    tolerance: float = 0.05


class SegmentTracker:
    """Velocity commands that bring a robot from where it stands to a goal along the straight segment.

    The robot turns where it stands until it looks along the segment, then drives by pure pursuit (Coulter, 1992)
    under acceleration limits, and brakes so that it stops at the goal.
    """

    _START_DRIVING = 0.06
    _STOP_DRIVING = 0.9
    _ARRIVAL_SPEED = 0.06

    def __init__(self, start: Pose, goal: tuple[float, float], limits: DriveLimits) -> None:
        """Plan from ``start`` to ``goal``, metres in the map frame."""
        self._limits = limits
        self._goal = goal
        self._origin = start.position
        length = start.distance_to(goal)
        self._length = length
        self._direction = ((goal[0] - start.x) / length, (goal[1] - start.y) / length) if length > 0.0 else (1.0, 0.0)
        self._driving = False
        self._speed = 0.0
        self._turn_rate = 0.0

    def at_goal(self, pose: Pose) -> bool:
        """Whether a pose is within the tolerance of the goal."""
        return pose.distance_to(self._goal) <= self._limits.tolerance

    def command(self, pose: Pose, interval: float) -> tuple[float, float]:
        """Return speed (m/s) and turn rate (rad/s) for the next ``interval`` seconds."""
        limits = self._limits
        along = self._along(pose)
        remaining = pose.distance_to(self._goal)
        lookahead = min(max(0.4, 0.5 * self._speed), 1.0)
        x, y = self._point(along + lookahead) if remaining > lookahead else self._goal
        error = wrap_angle(math.atan2(y - pose.y, x - pose.x) - pose.yaw)
        if self.at_goal(pose):
            speed, turn_rate = 0.0, 0.0
        elif self._driving and abs(error) < self._STOP_DRIVING:
            stopping = math.sqrt(2.0 * 0.9 * limits.deceleration * remaining)
            speed = max(self._ARRIVAL_SPEED, min(limits.speed, stopping)) * max(0.0, math.cos(error))
            # Pure pursuit's curvature, and enough turning at low speed to look at the goal all the same.
            turn_rate = 2.0 * max(self._speed, 0.4) * math.sin(error) / min(lookahead, max(remaining, 0.1))
        else:
            self._driving = abs(error) < self._START_DRIVING
            stopping = math.sqrt(1.2 * limits.turn_acceleration * abs(error))
            speed, turn_rate = 0.0, math.copysign(min(stopping, 8.0 * abs(error)), error)
        self._speed = _approach(self._speed, speed, limits.acceleration * interval, limits.deceleration * interval)
        turn_rate = max(-limits.turn_rate, min(limits.turn_rate, turn_rate))
        change = limits.turn_acceleration * interval
        self._turn_rate = max(self._turn_rate - change, min(self._turn_rate + change, turn_rate))
        return self._speed, self._turn_rate

    def time_limit(self) -> float:
        """Return a generous time for the segment, seconds: three times what an unhindered robot needs."""
        limits = self._limits
        ramps = limits.speed / limits.acceleration + limits.speed / limits.deceleration
        turn = math.pi / limits.turn_rate + limits.turn_rate / limits.turn_acceleration
        return 3.0 * (self._length / limits.speed + ramps + turn)

    def _along(self, pose: Pose) -> float:
        return (pose.x - self._origin[0]) * self._direction[0] + (pose.y - self._origin[1]) * self._direction[1]

    def _point(self, along: float) -> tuple[float, float]:
        return self._origin[0] + along * self._direction[0], self._origin[1] + along * self._direction[1]


def wrap_angle(angle: float) -> float:
    """Return the angle in [-pi, pi)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def _approach(value: float, target: float, rise: float, fall: float) -> float:
    return min(target, value + rise) if target > value else max(target, value - fall)
