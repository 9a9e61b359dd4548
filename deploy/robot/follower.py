"""The robot's own waypoint following, as the CMU autonomy stack and nav2 bring it along."""

from __future__ import annotations

import math
import threading

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from deploy.config import DrivingConfig
from deploy.driving import LocalPlanner

# std_msgs/Int8 on /stop of the CMU stack.
GO, STOP_LINEAR, STOP_ALL = 0, 1, 2


class WaypointFollower:
    """Drives to the newest waypoint and stands there; what it is told may come from any thread."""

    def __init__(self, config: DrivingConfig, hold_time: float = 0.5) -> None:
        """Stand still; ``hold_time`` is how long one `hold` lasts, seconds."""
        self._config = config
        self._hold_time = hold_time
        self._held = -math.inf
        self._planner = LocalPlanner(config)
        self._lock = threading.Lock()
        self._waypoint: tuple[float, float] | None = None
        self._fresh = False
        self._stop = GO
        self._speed = config.max_speed

    def aim(self, waypoint: tuple[float, float]) -> None:
        """Take a waypoint, metres in the map frame; one that is not finite is ignored."""
        if np.isfinite(waypoint).all():
            with self._lock:
                self._fresh = self._fresh or waypoint != self._waypoint
                self._waypoint = waypoint

    def stop(self, level: int) -> None:
        """0 lets both pass, 1 takes the linear velocity away, 2 also the angular one."""
        with self._lock:
            self._stop = level

    def limit(self, speed: float) -> None:
        """Drive at most this fast, m/s, and never faster than the limits of the configuration."""
        if np.isfinite(speed):
            with self._lock:
                self._speed = max(0.0, min(speed, self._config.max_speed))

    def hold(self, now: float) -> None:
        """Stand for a moment, as when somebody else publishes zero velocities to the base; seconds of any clock."""
        with self._lock:
            self._held = now

    def command(
        self, pose: Pose, velocity: tuple[float, float], obstacles: NDArray[np.float64], interval: float, now: float
    ) -> tuple[float, float]:
        """Return speed (m/s) and turn rate (rad/s) for the next ``interval`` seconds.

        Args:
            pose: map frame.
            velocity: measured, m/s and rad/s.
            obstacles: metres, map frame, shape (n, 2).
            interval: seconds.
            now: seconds of the clock of `hold`.
        """
        with self._lock:
            waypoint, fresh, stop, limit = self._waypoint, self._fresh, self._stop, self._speed
            held = now - self._held <= self._hold_time
            self._fresh = False
        if fresh:
            self._planner.reset()
        if waypoint is None or held or stop >= STOP_ALL:
            return 0.0, 0.0
        command = self._planner.command(pose, velocity, [waypoint], obstacles, interval)
        speed = 0.0 if stop >= STOP_LINEAR else max(-limit, min(limit, command.linear))
        return speed, command.angular
