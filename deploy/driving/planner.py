"""Follow a path among obstacles with a round differential-drive robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from deploy.config import DrivingConfig


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

    Usage, at `config.rate`::

        command = planner.command(pose, (v, w), path, obstacles, dt)
        gate.wish(command.linear, command.angular)
    """

    def __init__(self, config: DrivingConfig) -> None:
        self._config = config

    def reset(self) -> None:
        """Forget recoveries under way; call it when the waypoint changes by more than the path's own progress."""

    def command(
        self,
        pose: Pose,
        velocity: tuple[float, float],
        path: Sequence[tuple[float, float]],
        obstacles: NDArray[np.float64],
        dt: float,
    ) -> Command:
        """Choose the next velocity.

        Args:
            pose: of the robot's centre in the map frame.
            velocity: measured (m/s, rad/s).
            path: (x, y) in the map frame, metres, the last one being the goal; the robot may be anywhere beside it.
            obstacles: (n, 2) points in the map frame, metres.
            dt: seconds until the next command.
        """
        raise NotImplementedError
