"""The firmware of a mobile base: velocity commands with limits, ramps and a time-out become wheel velocities."""

from __future__ import annotations

import math
import threading
from collections import deque

from deploy.robot.options import RobotOptions


class DriveBase:
    """Follows the newest velocity command as well as the base can, and stops without one.

    Commands may come from any thread; `advance` belongs to the simulation's.
    """

    def __init__(self, options: RobotOptions) -> None:
        self._options = options
        # In slow motion the bridge may take its time too.
        self._timeout = options.command_timeout / min(1.0, options.speed_factor)
        self._lock = threading.Lock()
        self._waiting: deque[tuple[float, float, float, float]] = deque()
        self._command = (0.0, 0.0)
        self._heard = -math.inf
        self._speed = 0.0
        self._turn_rate = 0.0
        self.refused = 0

    @property
    def commanded(self) -> tuple[float, float]:
        """Speed (m/s) and turn rate (rad/s) that the motors are told now."""
        return self._speed, self._turn_rate

    def receive(self, speed: float, turn_rate: float, now: float, due: float) -> None:
        """Take a command.

        Args:
            speed: m/s, negative backwards.
            turn_rate: rad/s, counter-clockwise.
            now: when it came, seconds of the clock that the time-out is measured by.
            due: when it has its effect, seconds of the robot.
        """
        if not (math.isfinite(speed) and math.isfinite(turn_rate)):
            # A base that drives on an infinite or missing number is what a watchdog is for; ours refuses it.
            self.refused += 1
            return
        with self._lock:
            self._waiting.append((due, now, speed, turn_rate))

    def advance(self, now: float, time: float, interval: float) -> tuple[float, float]:
        """Return speed (m/s) and turn rate (rad/s) for the next ``interval`` seconds of the robot.

        Args:
            now: seconds of the clock that the time-out is measured by.
            time: seconds of the robot.
            interval: seconds of the robot.
        """
        with self._lock:
            while self._waiting and self._waiting[0][0] <= time:
                _, self._heard, *command = self._waiting.popleft()
                self._command = (command[0], command[1])
        options = self._options
        speed, turn_rate = self._command if now - self._heard <= self._timeout else (0.0, 0.0)
        speed = max(-options.max_speed, min(options.max_speed, speed))
        turn_rate = max(-options.max_turn_rate, min(options.max_turn_rate, turn_rate))
        self._speed = _ramp(self._speed, speed, options.acceleration * interval, options.deceleration * interval)
        change = options.turn_acceleration * interval
        self._turn_rate = _ramp(self._turn_rate, turn_rate, change, change)
        return self._speed, self._turn_rate


def _ramp(value: float, target: float, rise: float, fall: float) -> float:
    """Move a value towards a target, by ``rise`` at most away from zero and ``fall`` at most towards it."""
    if value * target < 0.0:
        target = 0.0
    limit = rise if abs(target) > abs(value) else fall
    return max(value - limit, min(value + limit, target))
