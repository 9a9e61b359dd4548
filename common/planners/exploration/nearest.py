"""Nearest frontier: the oldest and simplest exploration strategy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.viewpoint_planner import ViewpointPlanner
from common.planners.visibility import observed


class NearestPlanner(ViewpointPlanner):
    """Drive up to the nearest frontier, by path length, decided again at each viewpoint.

    B. Yamauchi: "A Frontier-Based Approach for Autonomous Exploration", IEEE International Symposium on Computational
    Intelligence in Robotics and Automation (CIRA), 1997.

    As published: the goal is the nearest accessible frontier, the robot drives to the frontier itself and not just to
    where it can be seen from, and a place that did not resolve its frontier counts as inaccessible afterwards.
    Otherwise: the robot drives to the viewpoint of the graph that is nearest to the frontier, because waypoints are
    viewpoints here; the goal is chosen again after each edge and not only on arrival, because the belief has grown by
    then; and frontier cells are not grouped into regions with a least size, because the nearest cell tells the nearest
    region and viewpoints that observe fewer than `MappingConfig.min_utility` frontier cells are no candidates anyway.
    """

    name = "nearest"

    def choose(
        self, mapper: Mapper, pose: Pose, candidates: NDArray[np.int64], positions: NDArray[np.float64]
    ) -> list[int]:
        """Return the candidate next to the nearest frontier cell."""
        del pose
        frontiers = mapper.frontiers
        reach = self.config.observable_range
        distances = mapper.distances(mapper.robot)
        order = np.argsort(distances[candidates], kind="stable")
        best, goal = np.inf, -1
        # A candidate cannot beat a way to a frontier that is shorter than the way to the candidate itself.
        for node in candidates[order]:
            if distances[node] >= best:
                break
            gaps = np.hypot(*(frontiers - positions[node]).T)
            near = np.flatnonzero(gaps <= reach)
            near = near[observed(mapper.belief, positions[[node]], frontiers[near], reach)[0]]
            if not len(near):
                continue
            at = near[np.argmin(gaps[near])]
            if distances[node] + gaps[at] < best:
                best, goal = float(distances[node] + gaps[at]), int(at)
        if goal < 0:
            return []
        frontier = frontiers[[goal]]
        gaps = np.hypot(*(positions[candidates] - frontier[0]).T)
        near = np.flatnonzero(gaps <= reach)
        sees = observed(mapper.belief, positions[candidates[near]], frontier, reach)[:, 0]
        near = near[sees]
        return [int(candidates[near[np.argmin(gaps[near] + 1e-3 * distances[candidates[near]])]])]
