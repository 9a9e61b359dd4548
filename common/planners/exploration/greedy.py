"""Greedy utility: what can be observed, discounted by the way there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.config import MappingConfig
from common.errors import ConfigError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.viewpoint_planner import ViewpointPlanner
from common.planners.visibility import observed


class GreedyPlanner(ViewpointPlanner):
    """Go to the viewpoint with the largest utility x exp(-path length / scale), decided again at each viewpoint.

    H. H. Gonzalez-Banos, J.-C. Latombe: "Navigation Strategies for Exploring Indoor Environments", International
    Journal of Robotics Research, 2002, section 5: a candidate is worth A(q) exp(-lambda L(q)).

    As published: the trade-off and its exponential form, path length over known free space, and one decision for each
    scan. Otherwise, and why:

    - A(q) is the number of observable frontier cells within `cover_range`, the utility of this project's viewpoints on
      a shorter range, instead of the area visible through free curves: a frontier at the very end of the sensor's range
      would show nothing new from there. The area was tried on training maps, and its tours were 3 % longer or more.
    - Candidates are the viewpoints of the graph instead of random samples near the frontiers: they are the waypoints of
      every planner here.
    - A viewpoint that observes less than `min_frontier` is no candidate until nothing larger is left, as the
      publication leaves out free curves that are too short for the robot.
    - lambda is 1 / 15 m instead of 1 / 5 m, for a sensor of 20 m.
    - Left out: the overlap with the known map that its matching of scans needs, because poses are known here.
    """

    name = "greedy"

    def __init__(
        self,
        config: MappingConfig,
        *,
        scale: float = 15.0,
        cover_range: float | None = None,
        min_frontier: float = 5.0,
    ) -> None:
        """Set up.

        Args:
            config: the mapping that the planner will be given.
            scale: metres of way that a factor e in utility is worth.
            cover_range: frontiers count up to here, metres; 0.8 of the sensor range when not given.
            min_frontier: metres of frontier that a candidate observes within this range, until nothing else is left.

        Raises:
            ConfigError: a setting is not above 0.
        """
        cover_range = 0.8 * config.sensor_range if cover_range is None else cover_range
        for setting, value in (("scale", scale), ("cover_range", cover_range), ("min_frontier", min_frontier)):
            if not value > 0.0:
                raise ConfigError(f"planner 'greedy': {setting} must be above 0 m, got {value}")
        self._scale = scale
        self._cover_range = min(cover_range, config.observable_range)
        self._least = min_frontier / config.resolution
        super().__init__(config)

    def choose(
        self, mapper: Mapper, pose: Pose, candidates: NDArray[np.int64], positions: NDArray[np.float64]
    ) -> list[int]:
        """Return the best candidate; of equally good ones the nearest, then the lowest node number."""
        del pose
        seen = observed(mapper.belief, positions[candidates], mapper.frontiers, self._cover_range).sum(axis=1)
        useful = mapper.observe().utility[candidates]
        # Everything near enough, else anything near enough, else whatever can be seen at all.
        counts = next(each for each in (np.where(seen >= self._least, seen, 0), seen, useful) if each.any())
        distances = mapper.distances(mapper.robot)[candidates]
        with np.errstate(divide="ignore"):
            value = np.log(counts.astype(np.float64)) - distances / self._scale
        best = np.flatnonzero(value >= value.max() - 1e-9)
        return [int(candidates[best[np.argmin(distances[best])]])]
