"""Follow a path among obstacles with a round differential-drive robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, copysign, hypot, isfinite, pi, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from deploy.config import DrivingConfig
from deploy.driving.costmap import LocalCostmap
from deploy.driving.course import Course, CourseFinder
from deploy.driving.pursuit import PathTracker, Position
from deploy.driving.recovery import ProgressWatch, Remedy
from deploy.driving.window import DynamicWindow, Motion, Velocity

_IN_THE_WAY: Final = "an obstacle is in the way"
_AT_GOAL: Final = 0.08
# Turn on the spot when the point ahead is so far off, and until it is within the second angle.
_TURN_BEGIN, _TURN_END = 1.0, 0.25
_CREEP: Final = 0.15
_BACK_OFF_SPEED: Final = 0.15
# The last command may lead the measured velocity by what the drive's delay explains.
_LEAD: Final = 0.3
_FULL_SPEED_ROOM: Final = 0.25


@dataclass(frozen=True, slots=True)
class Command:
    """What the robot should do until the next command.

    Attributes:
        linear: m/s, forwards positive.
        angular: rad/s, counter-clockwise positive.
        blocked: there has been no way forward for a while: choose another waypoint.
        reason: why the robot stands or is blocked, in words for its operator; empty while it drives.
    """

    linear: float
    angular: float
    blocked: bool = False
    reason: str = ""


class LocalPlanner:
    """Follow a path among obstacles.

    The robot steers for a point ahead on the path, or on a way around what blocks the path, found by A* in the local
    costmap; velocities come from the dynamic window, so that it can always brake in time. It turns on the spot when
    the way is behind it, backs off and looks around when it gets nowhere, and then says that it is blocked.

    Usage, at `config.rate`::

        command = planner.command(pose, (v, w), path, obstacles, dt)
        gate.command(command.linear, command.angular)
    """

    def __init__(self, config: DrivingConfig) -> None:
        """Prepare, and compile the kernels, so that the first command comes in time."""
        self._config = config
        self._costmap = LocalCostmap(config)
        self._window = DynamicWindow(config)
        self._courses = CourseFinder(self._costmap)
        self._watch = ProgressWatch()
        self._path: PathTracker | None = None
        self._remaining = 0.0
        self._now = 0.0
        self._turning = False
        self._turn = 0.0
        self._last: Velocity = (0.0, 0.0)
        self._warm_up()

    def reset(self) -> None:
        """Forget progress and remedies under way; call it when the robot is sent somewhere else, or stood for a while.

        How far it has come along its path is forgotten with the next other path alone.
        """
        self._courses.forget()
        self._watch.reset()
        self._turning = False

    def command(
        self,
        pose: Pose,
        velocity: Velocity,
        path: Sequence[Position],
        obstacles: NDArray[np.float64],
        dt: float,
    ) -> Command:
        """Choose the next velocity.

        It differs from the last command by what the acceleration limits allow in `dt`; where the robot did not follow
        the last command, from what it does instead.

        Args:
            pose: of the robot's centre in the map frame.
            velocity: measured (m/s, rad/s).
            path: (x, y) in the map frame, metres, the last one being the goal; made for a robot near here.
            obstacles: (n, 2) points in the map frame, metres.
            dt: seconds until the next command.
        """
        self._now += dt
        # Whole numbers would be another type to the kernels, and compiled for at the worst moment.
        pose, velocity = Pose(float(pose.x), float(pose.y), float(pose.yaw)), (float(velocity[0]), float(velocity[1]))
        motion = Motion(pose, velocity, self._base(velocity), dt)
        if not all(map(isfinite, (pose.x, pose.y, pose.yaw, *velocity))):
            return self._brake(Motion(Pose(0.0, 0.0), self._last, self._last, dt), "the pose is not finite")
        obstacles = obstacles[np.isfinite(obstacles).all(axis=1)]
        self._costmap.update(pose.x, pose.y, obstacles, self._now)
        self._window.look(self._costmap, motion, self._lookahead(motion))
        if not path:
            self.reset()
            return self._brake(motion, "there is no path")
        another = self._path is None or self._path.path != tuple(path)
        if self._path is None or another:
            self._path = PathTracker(path)
            self._courses.forget()
        if pose.distance_to(self._path.goal) <= _AT_GOAL:
            self._watch.reset()
            return self._brake(motion, "the end of the path is reached")
        course = self._courses.find(pose.position, self._path, self._lookahead(motion), self._now)
        if another:
            self._watch.shift(course.remaining - self._remaining)
        self._remaining = course.remaining
        remedy = self._watch.update(course.remaining, dt, turning=self._turning)
        command = self._remedy(motion, remedy) if remedy is not Remedy.NONE else self._drive(motion, course)
        if self._watch.blocked:
            return Command(command.linear, command.angular, True, command.reason or "the robot makes no way")
        return command

    def _drive(self, motion: Motion, course: Course) -> Command:
        if course.carrot is None:
            self._turning = False
            return self._brake(motion, self._blocked(motion, "no way leads on between obstacles within the local map"))
        error = _wrap(atan2(course.carrot[1] - motion.pose.y, course.carrot[0] - motion.pose.x) - motion.pose.yaw)
        self._turning = abs(error) > (_TURN_END if self._turning else _TURN_BEGIN)
        if self._turning:
            turn = self._window.step(motion, (0.0, self._turn_rate(error)))
            if self._window.safe(motion, turn):
                return self._send(turn, "")
            return self._brake(motion, "")
        choice = self._window.choose(motion, course.carrot, self._speed(motion, course.remaining), self._turn)
        if choice is None:
            # Not even straight ahead or on the spot: the stop that was checked before still holds.
            return self._brake(motion, self._blocked(motion, _IN_THE_WAY))
        command, self._turn = choice
        return self._send(command, "" if hypot(*command) > 0.01 else self._blocked(motion, _IN_THE_WAY))

    def _blocked(self, motion: Motion, reason: str) -> str:
        """Add to why the robot stands what to do where an obstacle so near may be a part of the robot."""
        _, distances = self._costmap.near(*motion.pose.position, self._costmap.room)
        if not len(distances):
            return reason
        return (
            f"{reason}: one is {distances.min():.2f} m from the robot's centre; if it moves with the robot, it is a "
            "part of it that driving.robot_radius or driving.footprint must enclose"
        )

    def _speed(self, motion: Motion, remaining: float) -> float:
        """Slow down towards the goal and between obstacles."""
        config = self._config
        stopping = sqrt(2.0 * 0.8 * config.max_acceleration * max(remaining - 0.5 * _AT_GOAL, 0.0))
        _, distances = self._costmap.near(*motion.pose.position, self._costmap.room + _FULL_SPEED_ROOM)
        room = float(distances.min()) - self._costmap.room if len(distances) else _FULL_SPEED_ROOM
        share = min(max(room / _FULL_SPEED_ROOM, 0.0), 1.0)
        return max(min(config.max_speed * (0.35 + 0.65 * share), stopping), min(_CREEP, config.max_speed))

    def _lookahead(self, motion: Motion) -> float:
        return max(self._config.lookahead, 0.8 * abs(motion.velocity[0]))

    def _turn_rate(self, error: float) -> float:
        """Turn as fast as allows to stop at the right heading, radians."""
        config = self._config
        rate = min(sqrt(1.2 * config.max_turn_acceleration * abs(error)), 3.0 * abs(error), config.max_turn_rate)
        return copysign(rate, error)

    def _remedy(self, motion: Motion, remedy: Remedy) -> Command:
        self._courses.forget()
        if remedy is Remedy.BACK_OFF:
            self._turning = False
            command = self._window.step(motion, (-min(_BACK_OFF_SPEED, self._config.max_speed), 0.0))
            if self._window.safe(motion, command):
                return self._send(command, "backing off")
        turn = self._window.step(motion, (0.0, 0.5 * self._config.max_turn_rate))
        return self._send(turn, "looking for a way") if self._window.safe(motion, turn) else self._brake(motion, "")

    def _brake(self, motion: Motion, reason: str) -> Command:
        return self._send(self._window.step(motion, (0.0, 0.0)), reason)

    def _send(self, command: Velocity, reason: str) -> Command:
        self._last = command
        return Command(*command, reason=reason)

    def _base(self, velocity: Velocity) -> Velocity:
        linear, angular = _LEAD * self._config.max_acceleration, _LEAD * self._config.max_turn_acceleration
        return (
            min(max(self._last[0], velocity[0] - linear), velocity[0] + linear),
            min(max(self._last[1], velocity[1] - angular), velocity[1] + angular),
        )

    def _warm_up(self) -> None:
        wall = np.array([[0.9, y] for y in np.linspace(-0.5, 0.5, 11)])
        for obstacles in (wall, np.empty((0, 2))):
            self.command(Pose(0.0, 0.0), (0.0, 0.0), [(2.0, 0.0)], obstacles, 0.05)
        self._window.safe(Motion(Pose(0.0, 0.0), (0.0, 0.0), (0.0, 0.0), 0.05), (0.0, 0.0))
        self._costmap.forget()
        self.reset()
        self._last = (0.0, 0.0)


def _wrap(angle: float) -> float:
    return (angle + pi) % (2.0 * pi) - pi
