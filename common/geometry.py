"""Poses and range scans, in ROS conventions: metres, x right, y up, radians counter-clockwise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Pose:
    """Planar pose of the robot in the map frame.

    Attributes:
        x: metres.
        y: metres.
        yaw: radians, counter-clockwise from the x axis.
    """

    x: float
    y: float
    yaw: float = 0.0

    @property
    def position(self) -> tuple[float, float]:
        """The (x, y) part, metres."""
        return self.x, self.y

    def distance_to(self, position: tuple[float, float]) -> float:
        """Straight distance to a position, metres."""
        return float(np.hypot(position[0] - self.x, position[1] - self.y))


@dataclass(frozen=True, slots=True)
class Scan:
    """One planar range scan, as ROS LaserScan carries it.

    Beam ``i`` points at ``pose.yaw + angle_min + i * angle_increment``. A range at or above ``range_max`` (or
    infinite) means that the beam met nothing within ``range_max``; NaN and values below ``range_min`` are
    invalid beams and carry no information.

    Attributes:
        ranges: metres, float32, shape (beams,).
        angle_min: radians, direction of beam 0 in the robot's frame.
        angle_increment: radians between neighbouring beams.
        range_max: metres.
        range_min: metres.
    """

    ranges: NDArray[np.float32]
    angle_min: float
    angle_increment: float
    range_max: float
    range_min: float = 0.0
