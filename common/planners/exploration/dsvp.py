"""Dual-stage viewpoint planning: explore around the robot while something is left there, else relocate."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.config import MappingConfig
from common.errors import ConfigError
from common.geometry import Pose
from common.mapping.cell_grid import CellGrid
from common.mapping.mapper import Mapper
from common.planners.base import Plan, Position, Status
from common.planners.exploration.roadmap import Roadmap, trace
from common.planners.exploration.rrt import Tree
from common.planners.exploration.sampling import Corner, SamplingPlanner
from common.planners.visibility import observed
from common.system.jit import njit

# Least distance between places of the global roadmap, spacings.
GLOBAL_SPREAD: Final = 0.75
# How often the global roadmap is extended over all known space before the exploration is declared complete.
EXTENSIONS: Final = 5
# A robot this near to a place is where the place is, metres: robots do not stop more exactly.
BESIDE: Final = 0.3
# Share of the samples that are drawn around the frontiers ahead, and how many of those there are.
FRONTIER_SHARE: Final = 0.25
FRONTIERS_AHEAD: Final = 3


@njit(cache=True, nogil=True)
def _detour(way: NDArray[np.float64], direction: NDArray[np.float64]) -> float:
    """Return the mean dynamic-time-warping distance, metres, between a way and a straight one of as many points."""
    count = len(way)
    length = 0.0
    for k in range(1, count):
        length += np.hypot(way[k, 0] - way[k - 1, 0], way[k, 1] - way[k - 1, 1])
    stride = length / max(count - 1, 1)
    cost = np.full((count + 1, count + 1), np.inf)
    cost[0, 0] = 0.0
    for i in range(count):
        for j in range(count):
            x = way[0, 0] + direction[0] * stride * j
            y = way[0, 1] + direction[1] * stride * j
            gap = np.hypot(way[i, 0] - x, way[i, 1] - y)
            cost[i + 1, j + 1] = gap + min(cost[i, j + 1], cost[i + 1, j], cost[i, j])
    return cost[count, count] / count


class DsvpPlanner(SamplingPlanner):
    """Explore with a random roadmap inside a local horizon; relocate over a global roadmap when it finds nothing.

    H. Zhu, C. Cao, Y. Xia, S. Scherer, J. Zhang, W. Wang: "DSVP: Dual-Stage Viewpoint Planner for Rapid Exploration by
    Dynamic Expansion", IEEE/RSJ International Conference on Intelligent Robots and Systems (IROS), 2021.

    As published: inside a square horizon around the robot a random tree is expanded dynamically: what is left of it
    from the last decision is pruned to the new horizon and extended, with a part of the samples drawn around the local
    frontiers nearest to the direction of exploration; a place gains the unknown volume that it sees, falling with the
    length of the way; a branch gains the sum over its places, falling with its dynamic-time-warping distance from the
    direction of exploration; the best branch is followed, and sets the direction. The ways to all places with a gain
    join a global graph, which stays connected. When nothing in the horizon gains, the robot relocates: over the global
    graph to the nearest place that still sees the unknown; when no place does, the graph is extended over all known
    space, and the exploration is declared complete when that finds nothing either.

    Otherwise: the volume is an area, because the world is planar (see `unknown_in_sight`); both factors are
    exponentials of lengths in metres, as in the publication's text, where its released code divides by them; a place
    that was just scanned from in vain gains nothing (see `SamplingPlanner`); the goal of a relocation is a place with a
    gain, where the publication takes one that has a global frontier in sight; and the last extension draws half of its
    samples around frontiers that no place sees from near, because others seldom pass a door of 1 m.

    Left out: the terrain analysis, because walls are all there is. Places and edges keep clear of obstacles by the
    robot's radius, in the publication by its bounding box.
    """

    name = "dsvp"

    def __init__(
        self,
        config: MappingConfig,
        *,
        horizon: float = 24.0,
        samples: int = 200,
        nodes: int = 120,
        decay: float = 0.3,
        turning: float = 0.03,
        min_gain: float = 2.0,
    ) -> None:
        """Set up.

        Args:
            config: the mapping that the planner will be given.
            horizon: half the side of the local square, metres.
            samples: drawn for each decision.
            nodes: of the local roadmap at most.
            decay: how the gain of a place falls with the way to it, per metre.
            turning: how the gain of a branch falls with its distance from the direction of exploration, per metre.
            min_gain: a place that sees less unknown area than this sees nothing, square metres.

        Raises:
            ConfigError: a setting is out of range.
        """
        if not (horizon > 0.0 and samples >= 1 and nodes >= 2 and min(decay, turning, min_gain) >= 0.0):
            raise ConfigError(
                "planner 'dsvp' expects horizon > 0, samples >= 1, nodes >= 2, decay, turning and min_gain >= 0, got "
                f"{horizon}, {samples}, {nodes}, {decay}, {turning} and {min_gain}"
            )
        self._horizon = horizon
        self._samples = samples
        self._nodes = nodes
        self._decay = decay
        self._turning = turning
        self._global_spread = GLOBAL_SPREAD * config.viewpoint_spacing
        super().__init__(config, min_gain)

    def begin(self) -> None:
        """Forget both roadmaps and the direction."""
        self._local = Roadmap(self.reach)
        self._global = Roadmap(self.reach)
        self._direction: NDArray[np.float64] | None = None

    def decide(self, mapper: Mapper, pose: Pose, low: Corner, high: Corner) -> Plan:
        """Explore inside the horizon; relocate when nothing is left there."""
        self._grow(mapper, pose, low, high)
        plan = self._explore(mapper)
        return plan if plan is not None else self._relocate(mapper, pose, low, high)

    def _grow(self, mapper: Mapper, pose: Pose, low: Corner, high: Corner) -> None:
        """Prune the local roadmap to the horizon around the robot and extend it; the robot is its place 0."""
        clear = mapper.clear
        here = np.array(pose.position)
        rest = self._local.points
        rest = rest[(np.abs(rest - here) <= self._horizon).all(axis=1)]
        rest = rest[np.hypot(*(rest - here).T) >= self.spread]
        self._local = Roadmap(self.reach)
        self._local.add(clear, np.vstack([here, rest]))
        self._local.keep(np.flatnonzero(np.isfinite(self._local.shortest(0)[0])))
        low, high = np.maximum(low, here - self._horizon), np.minimum(high, here + self._horizon)
        samples = self.samples(self._samples, low, high)
        ahead = self._frontiers_ahead(mapper, here)
        if len(ahead):
            biased = self.random.random(self._samples) < FRONTIER_SHARE
            around = ahead[self.random.integers(len(ahead), size=self._samples)]
            around = around + self.random.uniform(-1.0, 1.0, (self._samples, 2)) * self.config.sensor_range / 2
            samples[biased] = np.clip(around, low, high)[biased]
        tree = Tree(pose.position)
        tree.graft(self._local.points[1:])
        first = len(tree.points)
        tree.extend(clear, samples, capacity=self._nodes, step=self.reach, spread=self.spread)
        self._local.add(clear, tree.points[first:])

    def _frontiers_ahead(self, mapper: Mapper, here: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the frontier cells of the horizon that are nearest to the direction of exploration, metres."""
        frontiers = mapper.frontiers
        away = frontiers - here
        frontiers = frontiers[(np.abs(away) <= self._horizon).all(axis=1)]
        if self._direction is None or len(frontiers) <= FRONTIERS_AHEAD:
            return frontiers
        away = frontiers - here
        cosine = away @ self._direction / np.maximum(np.hypot(*away.T), 1e-9)
        return frontiers[np.argsort(-cosine, kind="stable")[:FRONTIERS_AHEAD]]

    def _explore(self, mapper: Mapper) -> Plan | None:
        """Return the first edge of the best branch of the local roadmap; None when nothing gains."""
        roadmap = self._local
        here = roadmap.points[0]
        distances, before = roadmap.shortest(0)
        gains = self.gains(mapper, roadmap.points) * np.exp(-self._decay * distances)
        useful = np.flatnonzero(gains > 0.0)
        ways = {int(node): trace(before, int(node)) for node in useful}
        known = [0, *dict.fromkeys(k for way in ways.values() for k in way[1:])]
        self._global.add_ways(mapper.clear, roadmap.points, before, known, self._global_spread)
        best, most = -1, 0.0
        for node, way in ways.items():
            worth = float(gains[way].sum())
            if self._direction is not None:
                worth *= float(np.exp(-self._turning * _detour(roadmap.points[way], self._direction)))
            if worth > most:
                best, most = node, worth
        if best < 0:
            return None
        route = [(float(x), float(y)) for x, y in roadmap.points[ways[best][1:]]]
        self._set_direction(here, route[-1])
        return Plan(Status.GOING, waypoint=route[0], beacon=route[-1], path=route[1:])

    def _relocate(self, mapper: Mapper, pose: Pose, low: Corner, high: Corner) -> Plan:
        """Return the first edge towards the nearest place of the global roadmap that sees the unknown."""
        clear = mapper.clear
        here = np.array(pose.position)
        robot = self._stand(clear, here)
        self._global.recheck(clear)
        roadmap = Roadmap(self.reach)
        roadmap.points, roadmap.lengths = self._global.points, self._global.lengths
        if robot is None:
            roadmap.add(clear, here[None])
            robot = len(roadmap) - 1
        for extension in range(EXTENSIONS + 1):
            if extension:
                self._extend(mapper, roadmap, low, high)
            distances, before = roadmap.shortest(robot)
            sees = (self.gains(mapper, roadmap.points) > 0.0) & np.isfinite(distances)
            if sees.any():
                goal = int(np.argmin(np.where(sees, distances, np.inf)))
                if extension:
                    ways = [trace(before, int(node)) for node in np.flatnonzero(sees)]
                    known = list(dict.fromkeys(k for way in ways for k in way))
                    self._global.add_ways(clear, roadmap.points, before, known, self._global_spread)
                route = [(float(x), float(y)) for x, y in roadmap.points[trace(before, goal)[1:]]]
                self._set_direction(here, route[0])
                return Plan(Status.GOING, waypoint=route[0], beacon=route[-1], path=route[1:])
        if len(roadmap) < 2 and len(self._local) < 2:
            return Plan(Status.STUCK, reason="no free way leads out of the robot's place")
        return Plan(Status.COMPLETE, reason=f"no place of {len(roadmap)} sees {self.min_gain:g} m2 of unknown area")

    def _stand(self, clear: CellGrid, here: NDArray[np.float64]) -> int | None:
        """Move a place that the robot stands beside to where it stands, and return its number; None without one.

        Else a robot that cannot stop exactly at a place would be sent there for ever, or to and fro, when the way on is
        free from the place but not from where the robot stopped.
        """
        beside = np.hypot(*(self._global.points - here).T) <= BESIDE
        if not beside.any():
            return None
        self._global.keep(np.flatnonzero(~beside))
        self._global.add(clear, here[None])
        return len(self._global) - 1

    def _extend(self, mapper: Mapper, roadmap: Roadmap, low: Corner, high: Corner) -> None:
        """Extend a roadmap over all known space, with half of the samples around frontiers that it does not see."""
        count = 10 * self._samples
        samples = self.samples(count, low, high)
        frontiers = mapper.frontiers
        seen = observed(mapper.belief, roadmap.points, frontiers, self.config.sensor_range / 2).any(axis=0)
        if not seen.all():
            frontiers = frontiers[~seen]
        if len(frontiers):
            around = frontiers[self.random.integers(len(frontiers), size=count // 2)]
            # Near and far alike: a door is found near the frontier that is seen through it.
            away = self.random.random((count // 2, 1)) * self.config.sensor_range / 2
            around = around + self.random.uniform(-1.0, 1.0, (count // 2, 2)) * away
            samples[: count // 2] = np.clip(around, low, high)
        self.random.shuffle(samples)
        tree = Tree((float(roadmap.points[-1, 0]), float(roadmap.points[-1, 1])))
        tree.graft(roadmap.points[:-1])
        first = len(tree.points)
        capacity = first + 2 * self._nodes
        # Places on both sides of a door are near to each other.
        tree.extend(mapper.clear, samples, capacity=capacity, step=self.reach, spread=self.spread / 2)
        roadmap.add(mapper.clear, tree.points[first:])

    def _set_direction(self, here: NDArray[np.float64], to: Position) -> None:
        away = np.array(to) - here
        self._direction = away / max(float(np.hypot(*away)), 1e-9)
