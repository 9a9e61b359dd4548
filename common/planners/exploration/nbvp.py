"""Receding-horizon next-best-view planning: a random tree, the branch that sees most, its first edge."""

from __future__ import annotations

from typing import Final

import numpy as np

from common.config import MappingConfig
from common.errors import ConfigError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.viewpoints import LONGEST_EDGE
from common.planners.base import Plan, Position, Status
from common.planners.exploration.rrt import Tree
from common.planners.exploration.sampling import Corner, SamplingPlanner
from common.planners.viewpoint_planner import TOLERANCE

# Samples that are drawn at once, and batches in a row without a new node after which a tree counts as full grown.
BATCH: Final = 500
PATIENCE: Final = 10


class NbvpPlanner(SamplingPlanner):
    """Grow a random tree in known free space and execute the first edge of its best branch.

    A. Bircher, M. Kamel, K. Alexis, H. Oleynikova, R. Siegwart: "Receding Horizon 'Next-Best-View' Planner for 3D
    Exploration", IEEE International Conference on Robotics and Automation (ICRA), 2016.

    As published (algorithm 1): an RRT from the robot's place; the gain of a node is that of its parent plus the unknown
    volume visible from it, times exp(-lambda c), c the length of the way to it; the tree starts with what is left of
    the last best branch; it grows to `nodes`, and on to `most_nodes` while no branch has a gain; then it is over.

    Otherwise: the volume is an area, measured along rays, because the world is planar; yaw is not sampled, because the
    sensor sees all around; a ray enters the unknown only over a frontier (see `unknown_in_sight`), so that gaps between
    beams on a wall are no gain; nodes keep a little distance from each other, because equal places have equal views;
    a place that was just scanned from in vain gains nothing (see `SamplingPlanner`); lambda and the longest edge fit a
    sensor of 20 m instead of 5 m; and samples are limited, so that in a large known space, where most of them lie
    behind walls, a tree may end with fewer than `most_nodes`. Left out: inspection of surfaces (a later variant). As in
    the publication there is no global stage: where all around the robot is explored, it may end before the rest is.
    """

    name = "nbvp"

    def __init__(
        self,
        config: MappingConfig,
        *,
        nodes: int = 50,
        most_nodes: int = 1000,
        decay: float = 0.2,
        min_gain: float = 2.0,
    ) -> None:
        """Set up.

        Args:
            config: the mapping that the planner will be given.
            nodes: N_max, nodes of a tree that has found a gain.
            most_nodes: N_TOL, nodes at most while there is none.
            decay: lambda, per metre.
            min_gain: g_zero: a node that sees less unknown area than this sees nothing, square metres.

        Raises:
            ConfigError: a setting is out of range.
        """
        if not (2 <= nodes <= most_nodes and decay >= 0.0 and min_gain >= 0.0):
            raise ConfigError(
                f"planner 'nbvp' expects 2 <= nodes <= most_nodes, decay >= 0 and min_gain >= 0, got nodes {nodes}, "
                f"most_nodes {most_nodes}, decay {decay}, min_gain {min_gain}"
            )
        self._nodes = nodes
        self._most_nodes = most_nodes
        self._decay = decay
        super().__init__(config, min_gain)

    def begin(self) -> None:
        """Forget the last best branch."""
        self._branch: list[Position] = []

    def decide(self, mapper: Mapper, pose: Pose, low: Corner, high: Corner) -> Plan:
        """Go the first edge of the best branch."""
        tree = self._replant(mapper, pose)
        gains = np.zeros(1)
        # Where known space is large, most samples lie behind walls: only a tree that grows no more may end the search.
        in_vain = 0
        while in_vain < PATIENCE:
            size = len(tree.points)
            capacity = self._nodes if size < self._nodes else self._most_nodes
            samples = self.samples(BATCH, low, high)
            tree.extend(mapper.clear, samples, capacity=capacity, step=self.reach, spread=self.spread)
            in_vain = in_vain + 1 if len(tree.points) == size else 0
            if len(tree.points) < self._nodes:
                continue
            gains = self._branch_gains(mapper, tree, gains)
            if gains.max() > 0.0 or len(tree.points) >= self._most_nodes:
                break
        gains = self._branch_gains(mapper, tree, gains)
        if len(tree.points) == 1:
            return Plan(Status.STUCK, reason="no free way leads out of the robot's place")
        best = int(np.argmax(gains))
        if gains[best] <= 0.0:
            self._branch = []
            return Plan(
                Status.COMPLETE, reason=f"no node of {len(tree.points)} sees {self.min_gain:g} m2 of unknown area"
            )
        self._branch = [(float(x), float(y)) for x, y in tree.points[tree.branch(best)]]
        return Plan(Status.GOING, waypoint=self._branch[0], beacon=self._branch[-1], path=self._branch[1:])

    def _replant(self, mapper: Mapper, pose: Pose) -> Tree:
        """Return a tree at the robot's place with what is left of the last best branch."""
        tree = Tree(pose.position)
        rest = self._branch
        if rest and pose.distance_to(rest[0]) <= TOLERANCE + self.spread:
            rest = rest[1:]
        reach = LONGEST_EDGE * self.config.viewpoint_spacing + TOLERANCE
        node = 0
        for point in rest:
            last = (float(tree.points[node][0]), float(tree.points[node][1]))
            if np.hypot(point[0] - last[0], point[1] - last[1]) > reach or not mapper.segment_free(last, point):
                break
            node = tree.append(point, node)
        return tree

    def _branch_gains(self, mapper: Mapper, tree: Tree, known: np.ndarray) -> np.ndarray:
        """Return the gain of each node's branch; those of the first nodes are known, the root's is 0."""
        first = len(known)
        if first == len(tree.points):
            return known
        worth = self.gains(mapper, tree.points[first:]) * np.exp(-self._decay * tree.depths[first:])
        gains = np.append(known, worth)
        for node in range(first, len(gains)):
            gains[node] += gains[tree.parents[node]]
        return gains
