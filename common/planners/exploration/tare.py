"""TARE-like exploration: one tour, detailed in the surroundings and coarse beyond."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from common.config import MappingConfig
from common.errors import ConfigError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Position, TaskName
from common.planners.exploration.cover import sample_cover, subspace_stops
from common.planners.exploration.held_tour import HeldTour
from common.planners.exploration.tour import load_ortools, open_tour, tour_length
from common.planners.viewpoint_planner import ViewpointPlanner
from common.planners.visibility import observed


class TarePlanner(ViewpointPlanner):
    """Cover the surroundings in detail and the rest coarsely, by one tour, replanned at each viewpoint.

    C. Cao, H. Zhu, H. Choset, J. Zhang: "TARE: A Hierarchical Framework for Efficiently Exploring Complex 3D
    Environments", Robotics: Science and Systems (RSS), 2021. This planner is TARE-like, not TARE.

    As published: inside a square local horizon that moves with the robot, sets of viewpoints that together cover what
    is not covered yet are sampled at random in proportion to their gain (algorithm 1), a tour is solved for each set,
    and the shortest one is kept; outside, space is divided into subspaces of which those with something left to
    explore are visited as wholes; a viewpoint covers what it sees within a range below that of the sensor; visited
    viewpoints are never chosen again; tours are solved by OR-Tools.

    Otherwise, and why:

    - One tour orders the local viewpoints and the subspaces together. The publication solves the tour over the
      subspaces first, cuts it at the horizon and solves the local part between the two cuts, because its local problem
      has hundreds of viewpoints in 3D. Here both fit into one small problem, and with the cut the robot turned back and
      forth where a subspace lies across the horizon: some maps did not end at all.
    - The tour ends anywhere. The publication returns home, which the protocol of this project does not ask for.
    - What has to be covered are frontier cells, not surface points: the world is planar and a wall is seen with the
      floor before it.
    - A viewpoint or a subspace that would add less than `min_frontier` waits while the tour through the larger ones
      begins nearby, less than `patience` away: passing by often shows it. One that would add `min_doorway` is taken
      along where that makes the tour at most `detour` longer, and before a way longer than `patience` counts like the
      rest, or a large building would be left full of rooms behind doors and driven through twice. What is smaller
      still waits until nothing else is left. The publication leaves nothing behind in its horizon but what its
      released code calls too few surface points, one threshold for all distances; so low a threshold makes tours 4 %
      longer on the public training maps, where an exploration is complete without most remainders.
    - A way between subspaces is a shortest path over the viewpoint graph, which takes the place of the keypose graph.
    - A robot that comes back to a viewpoint and has seen nothing new since keeps its tour until it does, see
      `HeldTour`: tours of equal length, replanned at each viewpoint, made it go back and forth forever. The released
      code counts changes of direction to the same end.
    - No smoothing of the path by the vehicle's dynamics (its section on trajectory optimisation): a decision is one
      straight edge of the viewpoint graph here.
    """

    name = "tare"

    def __init__(
        self,
        config: MappingConfig,
        *,
        horizon: float = 32.0,
        subspace: float = 16.0,
        cover_range: float | None = None,
        samples: int = 4,
        choices: int = 3,
        min_frontier: float = 5.0,
        min_doorway: float = 2.0,
        patience: float = 20.0,
        detour: float = 2.0,
    ) -> None:
        """Set up.

        Args:
            config: the mapping that the planner will be given.
            horizon: half the side of the local square, metres.
            subspace: side of a subspace, metres.
            cover_range: a viewpoint covers frontiers up to here, metres; 0.8 of the sensor range when not given. A
                frontier at the very end of the range would tell nothing new from there.
            samples: sets of viewpoints that are sampled for each decision; the shortest tour wins.
            choices: each viewpoint of a set is one of so many best.
            min_frontier: metres of frontier that a viewpoint or a subspace must add while such a one is nearby.
            min_doorway: metres of frontier that it must add otherwise, until nothing else is left.
            patience: metres of way to the first stop of a tour up to which `min_frontier` holds.
            detour: metres that a stop may lengthen such a tour by when it adds only `min_doorway`.

        Raises:
            ConfigError: a setting is out of range, or OR-Tools is not installed.
        """
        self._horizon = horizon
        self._subspace = subspace
        self._cover_range = 0.8 * config.sensor_range if cover_range is None else cover_range
        self._samples = samples
        self._choices = choices
        self._least = max(round(min_frontier / config.resolution), 1)
        self._doorway = max(round(min_doorway / config.resolution), 1)
        self._patience = patience
        self._detour = detour
        lengths = {
            "subspace": subspace,
            "cover_range": self._cover_range,
            "min_frontier": min_frontier,
            "min_doorway": min_doorway,
            "patience": patience,
        }
        for setting, value in lengths.items():
            if not value > 0.0:
                raise ConfigError(f"planner 'tare': {setting} must be above 0 m, got {value}")
        if not detour >= 0.0:
            raise ConfigError(f"planner 'tare': detour must be at least 0 m, got {detour}")
        for setting, number in (("samples", samples), ("choices", choices)):
            if number < 1:
                raise ConfigError(f"planner 'tare': {setting} must be at least 1, got {number}")
        load_ortools()
        super().__init__(config)

    def reset(self, task: TaskName, target: Position | None, seed: int) -> None:
        """Begin an episode: forget everything; equal seeds give equal episodes."""
        super().reset(task, target, seed)
        self._held = HeldTour()

    def choose(
        self, mapper: Mapper, pose: Pose, candidates: NDArray[np.int64], positions: NDArray[np.float64]
    ) -> list[int]:
        """Return the stops of the tour."""
        del pose
        return self._held.stops(mapper, candidates, positions, lambda: self._plan(mapper, candidates, positions))

    def _plan(self, mapper: Mapper, candidates: NDArray[np.int64], positions: NDArray[np.float64]) -> list[int]:
        """Return the stops of a new tour; what adds little counts only when nothing larger is near, or left at all."""
        frontiers = mapper.frontiers
        reach = self.config.observable_range
        away = mapper.distances(mapper.robot)
        for least, cover_range, patience in (
            (self._least, self._cover_range, self._patience),
            (self._doorway, self._cover_range, np.inf),
            (1, self._cover_range, np.inf),
            (1, reach, np.inf),
        ):
            seen = observed(mapper.belief, positions[candidates], frontiers, min(cover_range, reach))
            tour = self._tour(mapper, candidates, positions, seen, least)
            if tour and away[tour[0]] <= patience:
                return tour
        return []

    def _tour(
        self,
        mapper: Mapper,
        candidates: NDArray[np.int64],
        positions: NDArray[np.float64],
        seen: NDArray[np.bool_],
        least: int,
    ) -> list[int]:
        """Return the shortest tour of several samples; empty when no viewpoint adds `least` frontier cells."""
        places = positions[candidates]
        near = np.abs(places - positions[mapper.robot]).max(axis=1) <= self._horizon
        local, remote = np.flatnonzero(near), np.flatnonzero(~near)
        # Subspaces answer only for what cannot be seen from inside the horizon.
        beyond = seen[remote] & ~seen[local].any(axis=0)
        far = [int(candidates[remote[k]]) for k in subspace_stops(beyond, places[remote], self._subspace, least)]
        distances: dict[int, NDArray[np.float64]] = {}
        best: list[int] = []
        shortest, scan_here = np.inf, False
        for sample in range(self._samples):
            random = self.random if sample else None
            cover = sample_cover(seen[local], random, min_gain=least, choices=self._choices)
            nodes = [mapper.robot, *(int(candidates[local[k]]) for k in cover), *far]
            # The robot's own viewpoint, when it was not scanned from yet, is both the start and a stop.
            stops = list(dict.fromkeys(nodes))
            for node in stops:
                if node not in distances:
                    distances[node] = mapper.distances(node)
            between = np.array([distances[node][stops] for node in stops])
            order = open_tour(between)
            length = tour_length(between, order)
            if length < shortest and len(nodes) > 1:
                best, shortest = [stops[k] for k in order], length
                scan_here = mapper.robot in nodes[1:]
            if self._choices == 1 or not cover:
                break
        if not best:
            return []
        if least > self._doorway:
            best = self._take_along(mapper, best, candidates, seen, distances)
        return best if scan_here else best[1:]

    def _take_along(
        self,
        mapper: Mapper,
        tour: list[int],
        candidates: NDArray[np.int64],
        seen: NDArray[np.bool_],
        distances: dict[int, NDArray[np.float64]],
    ) -> list[int]:
        """Return a tour with the stops that add `min_doorway` where it passes them anyway."""
        at = {int(node): row for row, node in enumerate(candidates)}
        rest = ~seen[[at[node] for node in tour if node in at]].any(axis=0)
        tour = list(tour)
        while len(tour) > 1:
            counts = seen[:, rest].sum(axis=1)
            ends = np.array([distances[node][candidates] for node in tour])
            legs = np.array([distances[a][b] for a, b in pairwise(tour)])
            added = ends[:-1] + ends[1:] - legs[:, None]
            added[:, counts < self._doorway] = np.inf
            cheapest = added.min(axis=0)
            worth = np.where(cheapest <= self._detour, counts / (1.0 + cheapest), 0.0)
            row = int(np.argmax(worth))
            if not worth[row]:
                break
            node = int(candidates[row])
            tour.insert(int(np.argmin(added[:, row])) + 1, node)
            distances[node] = mapper.distances(node)
            rest &= ~seen[row]
        return tour
