"""What a lidar sees of the robot itself: returns within the robot's outline are no obstacles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.system.jit import njit
from deploy.config import DrivingConfig
from deploy.outline import edges_of


class OwnBody:
    """The robot's outline, which holds nothing but the robot: a convex polygon or a circle around the base.

    Attributes:
        edges: outward normals (x, y) and distances of the polygon's edges, float64, shape (k, 3); none for a circle.
        reach: radius of the smallest circle around the base that holds it, metres.
    """

    def __init__(self, config: DrivingConfig) -> None:
        """Take the outline that the local planner drives with."""
        edges = edges_of(config.footprint) if config.footprint else []
        self.edges: NDArray[np.float64] = np.array(edges, dtype=np.float64).reshape(-1, 3)
        self.reach = float(config.reach)

    def covers(self, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Say of each place in the base frame, metres, shape (n, 2), whether the robot's body is there.

        What is not finite is not covered.
        """
        return np.asarray(_covers(self.edges, self.reach, places))


@njit(cache=True, nogil=True)
def body_at(edges: NDArray[np.float64], reach: float, x: float, y: float) -> bool:
    """Whether the robot's body is at a place of the base frame, metres."""
    if not x * x + y * y <= reach * reach:
        return False
    outside = False
    for edge in range(len(edges)):
        outside |= edges[edge, 0] * x + edges[edge, 1] * y > edges[edge, 2]
    return not outside


@njit(cache=True, nogil=True)
def _covers(edges: NDArray[np.float64], reach: float, places: NDArray[np.float64]) -> NDArray[np.bool_]:
    covered = np.zeros(len(places), dtype=np.bool_)
    for n in range(len(places)):
        covered[n] = body_at(edges, reach, places[n, 0], places[n, 1])
    return covered
