"""The driving loop: the bridge's own local planner where it drives, and a pulse for the watchdog in any case."""

from __future__ import annotations

import logging
import re
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from common.planners.base import Position
from common.system.closing import Closing
from common.system.logs import lasting
from deploy.config import DrivingConfig
from deploy.driving import LocalPlanner
from deploy.safety.gate import VelocityGate
from deploy.safety.health import HealthMonitor

log = logging.getLogger(__name__)

_FIGURES = re.compile(r"[0-9.]+")


class Surroundings(Protocol):
    """What driving needs of `deploy.mapping.robot_map.RobotMap`."""

    @property
    def pose(self) -> Pose | None:
        """Newest pose."""
        ...

    def obstacles_near(self, pose: Pose, radius: float) -> NDArray[np.float64]:
        """Return obstacle points in the map frame, metres, shape (n, 2)."""
        ...


@dataclass(frozen=True, slots=True)
class DrivingRequest:
    """What the decision loop wants of the driving loop.

    Attributes:
        route: positions to drive along, metres; empty to stand.
        hold: why the robot stands.
        made: when, by `time.monotonic`.
        free: nothing is asked of the robot, so that a stack of its own may drive it wherever others want.
    """

    route: tuple[Position, ...]
    hold: str
    made: float
    free: bool = False


class DrivingLoop(Closing):
    """Drives along the newest route at `driving.rate`, in a thread of its own.

    It stands when the loop says so, when an input is stale or the pose jumps, and when the loop itself falls silent.

    Usage::

        with DrivingLoop(config, 1.0, robot_map, health, gate, velocity, may_move, loop.report_blocked) as driving:
            driving.follow(outcome.course.route)
    """

    def __init__(
        self,
        config: DrivingConfig,
        decision_rate: float,
        surroundings: Surroundings,
        health: HealthMonitor,
        gate: VelocityGate,
        velocity: Callable[[], tuple[float, float]],
        may_move: Callable[[], bool],
        on_blocked: Callable[[str], None],
    ) -> None:
        """Start the thread.

        Args:
            config: of the local planner, which drives where it is enabled.
            decision_rate: of the decision loop, Hz; after four decisions' time without a request the robot stands.
            surroundings: pose and obstacles.
            health: checked at every turn, so that a jump of the pose stops the robot at once.
            gate: takes the velocities.
            velocity: returns the measured one, (m/s, rad/s).
            may_move: whether the orders of this moment let the robot move; a command stops it sooner than the
                decision loop hears of it.
            on_blocked: told when there is no way on; must not block.
        """
        self._config = config
        self._surroundings = surroundings
        self._health = health
        self._gate = gate
        self._velocity = velocity
        self._may_move = may_move
        self._on_blocked = on_blocked
        self._planner = LocalPlanner(config) if config.enabled else None
        self._patience = max(1.0, 4.0 / decision_rate)
        self._request = DrivingRequest((), "the bridge has just started", time.monotonic())
        self._route: tuple[Position, ...] = ()
        self._told_blocked = False
        self._held = ("", "")
        self._stop = threading.Event()
        self.error = ""
        """Why the last turn of this thread failed; empty when it did not."""
        self._thread = threading.Thread(target=self._run, name="driving", daemon=True)
        self._thread.start()

    def follow(self, route: tuple[Position, ...]) -> None:
        """Drive along a route; to be said again at every pass of the decision loop."""
        self._request = DrivingRequest(route, "", time.monotonic())

    def stand(self, reason: str, *, free: bool = False) -> None:
        """Stand; to be said again at every pass of the decision loop.

        Args:
            reason: why, for the operator.
            free: nothing is asked of the robot: one whose own stack drives is left to others.
        """
        self._request = DrivingRequest((), reason, time.monotonic(), free)

    def close(self) -> None:
        """Stand and end the thread."""
        self._stop.set()
        self._thread.join()
        self._hold("the bridge ends")

    def _hold(self, reason: str) -> None:
        """Hold; a reason that differs in its figures alone is no news, and would fill the watchdog's log."""
        kind = _FIGURES.sub("", reason)
        if kind != self._held[0]:
            self._held = kind, reason
        self._health.commanded(time.monotonic(), 0.0, 0.0)
        self._gate.hold(self._held[1])

    def _run(self) -> None:
        period = 1.0 / self._config.rate
        due = time.monotonic()
        while not self._stop.wait(max(0.0, due - time.monotonic())):
            due = max(due + period, time.monotonic())
            try:
                self._turn(period)
                self.error = ""
            except Exception as error:
                # The robot stands, and whatever went wrong is tried again: this thread must not end.
                self._hold(f"the driving loop failed: {error}")
                before, self.error = self.error, str(error) or type(error).__name__
                if before != self.error:
                    log.exception("the driving loop failed: %s", self.error, extra=lasting(lambda: bool(self.error)))

    def _turn(self, period: float) -> None:
        now = time.monotonic()
        request = self._request
        if now - request.made > self._patience:
            self._hold(f"the decision loop has been silent for more than {self._patience:g} s")
            return
        if request.free and self._planner is None:
            self._held = ("", "")
            self._gate.resume()
            return
        if not (request.route and self._may_move()):
            self._route = ()
            self._hold(request.hold or "no order to move")
            return
        faults = self._health.check(now)
        pose = self._surroundings.pose
        if faults or pose is None:
            self._hold(faults[0].reason if faults else "no pose yet")
            return
        if self._planner is None:
            self._held = ("", "")
            self._gate.resume()
            return
        if request.route[0] not in self._route or (self._told_blocked and request.route != self._route):
            # Somewhere else, not just further along the old way; or another way after one that was blocked.
            self._planner.reset()
        if self._gate.state.in_other_hands:
            # A robot that does not do what it is told for that is not blocked.
            self._planner.reset()
        if request.route != self._route:
            self._route, self._told_blocked = request.route, False
        reach = self._config.costmap_size / 2.0
        obstacles = self._surroundings.obstacles_near(pose, reach)
        command = self._planner.command(pose, self._velocity(), request.route, obstacles, period)
        self._held = ("", "")
        self._gate.command(command.linear, command.angular)
        # What the watchdog keeps from the wheels need not show in the pose.
        passed = (command.linear, command.angular) if self._gate.state.clear else (0.0, 0.0)
        self._health.commanded(now, *passed)
        if command.blocked and not self._told_blocked:
            self._told_blocked = True
            self._on_blocked(command.reason)
