"""Greedy utility: what can be observed, discounted by the way there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.config.schema import MappingConfig
from common.errors import ConfigError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.lattice import LatticePlanner


class GreedyPlanner(LatticePlanner):
    """Go to the viewpoint with the largest utility x exp(-path length / scale), decided anew at each viewpoint.

    H. H. Gonzalez-Banos, J.-C. Latombe: "Navigation Strategies for Exploring Indoor Environments", International
    Journal of Robotics Research, 2002, section 5: a candidate is worth A(q) exp(-lambda L(q)).

    As published: the trade-off and its exponential form, path length over known free space, and one decision for each
    scan. Otherwise: A(q) is the number of observable frontier cells (the utility of this project's viewpoints) instead
    of the area visible through free curves, and candidates are the lattice's viewpoints instead of random samples,
    because both are at hand, exact and equal for every planner here; lambda is 1 / 15 m instead of 1 / 5 m, for a
    sensor of 20 m.
    """

    name = "greedy"

    def __init__(self, config: MappingConfig, *, scale: float = 15.0) -> None:
        """Set up.

        Args:
            config: the mapping that the planner will be given.
            scale: metres of way that a factor e in utility is worth.

        Raises:
            ConfigError: the scale is not above 0.
        """
        if not scale > 0.0:
            raise ConfigError(f"planner 'greedy': scale must be above 0 m, got {scale}")
        self._scale = scale
        super().__init__(config)

    def choose(
        self, mapper: Mapper, pose: Pose, candidates: NDArray[np.int64], positions: NDArray[np.float64]
    ) -> list[int]:
        """Return the best candidate; of equally good ones the nearest, then the lowest node number."""
        del pose, positions
        distances = mapper.distances(mapper.robot)[candidates]
        value = np.log(mapper.observe().utility[candidates].astype(np.float64)) - distances / self._scale
        best = np.flatnonzero(value >= value.max() - 1e-9)
        return [int(candidates[best[np.argmin(distances[best])]])]
