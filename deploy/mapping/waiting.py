"""Sensor messages between their arrival and the map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.geometry import Scan
from deploy.tf.transform import Transform

# Moments of a sweep at which the pose is looked up; between them it is interpolated.
_MOMENTS: Final = 3


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """A point cloud and the place from where it was seen.

    Attributes:
        points: float32, shape (n, 3 or more), metres.
        transform: where their frame lies in the map frame.
        sensor: x, y, z of the lidar in the map frame, metres.
        floor: height of the floor below the robot in the map frame, metres.
    """

    points: NDArray[np.float32]
    transform: Transform
    sensor: tuple[float, float, float]
    floor: float


@dataclass(frozen=True, slots=True, eq=False)
class Waiting:
    """A scan or a cloud that waits for the poses of its moments.

    Attributes:
        time: its stamp, seconds.
        data: what came; points float32, shape (n, 3), metres.
        frame: of its header, without a leading slash.
        first: when the first beam was sent, seconds after the stamp.
        sweep: time from the first beam to the last, seconds; 0 where all are of one moment.
        times: when each point was measured, seconds after the stamp, shape (n,); None for a scan, whose beams are
            evenly spaced, and where all are of one moment.
    """

    time: float
    data: Scan | NDArray[np.float32]
    frame: str
    first: float = 0.0
    sweep: float = 0.0
    times: NDArray[np.float64] | None = None

    @property
    def end(self) -> float:
        """When the last beam was sent, seconds."""
        return self.time + self.first + self.sweep

    @property
    def moments(self) -> list[float]:
        """Times from the first beam to the last at which the pose is looked up, seconds."""
        count = _MOMENTS if self.sweep > 0.0 else 1
        return [self.time + self.first + number * self.sweep / max(count - 1, 1) for number in range(count)]

    @property
    def kind(self) -> str:
        """Scan or cloud."""
        return "scan" if isinstance(self.data, Scan) else "cloud"

    @property
    def stream(self) -> str:
        """Its lidar."""
        return f"{self.kind} in {self.frame!r}"
