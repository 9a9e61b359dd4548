"""The beam pattern of a lidar and the noise of its ranges, shared by all simulators."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.geometry import Scan

_SHORTEST = 1e-3
_LIDAR_STREAM = 0x11DA2


class BeamPattern:
    """Evenly spread beams over the full circle; beam 0 points backwards, as ROS drivers of 360-degree lidars do."""

    def __init__(self, rays: int, range_max: float, noise: float = 0.0) -> None:
        """Set up ``rays`` beams of ``range_max`` metres with Gaussian range noise of ``noise`` metres."""
        self.rays = rays
        self.noise = noise
        self.angle_min = -np.pi
        self.angle_increment = 2.0 * np.pi / rays
        self.angles: NDArray[np.float64] = self.angle_min + self.angle_increment * np.arange(rays, dtype=np.float64)
        self.set_range(range_max)
        self._random = np.random.default_rng([_LIDAR_STREAM, 0])

    def set_range(self, range_max: float) -> None:
        """Let the beams reach ``range_max`` metres from now on."""
        self.range_max = range_max
        self._longest = float(np.nextafter(np.float32(range_max), np.float32(0.0)))

    def reseed(self, seed: int) -> None:
        """Start the noise of a new episode: the same seed gives the same noise."""
        self._random = np.random.default_rng([_LIDAR_STREAM, seed & (2**63 - 1)])

    def disturb(self, ranges: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return ranges with noise on every return; beams without a return (infinite) stay so.

        A disturbed return stays within (0, range_max), so that noise never turns a wall into open space.
        """
        if self.noise == 0.0:
            return ranges
        noisy = ranges + self._random.normal(0.0, self.noise, ranges.shape)
        return np.where(np.isfinite(ranges), np.clip(noisy, _SHORTEST, self._longest), ranges)

    def to_scan(self, ranges: NDArray[np.floating]) -> Scan:
        """Wrap planar ranges in beam order, metres, infinite where nothing was met."""
        return Scan(
            ranges=ranges.astype(np.float32),
            angle_min=self.angle_min,
            angle_increment=self.angle_increment,
            range_max=self.range_max,
        )
