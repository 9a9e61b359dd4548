"""The exploration expert: the shortest covering tour that it finds over the cells that are really missing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from actors.expert.base import UNREACHABLE, ExpertLabel, leg_lengths
from actors.expert.survey import Survey
from actors.maps.grid_map import GridMap
from actors.tasks.coverage import Coverage
from common.config import MappingConfig, TaskConfig
from common.errors import HDError
from common.geometry import Pose
from common.observations.observation import Observation
from common.planners.viewpoint_planner import ON_VIEWPOINT
from common.tours import cover
from common.tours.local_search import tour_length
from common.tours.prices import price_choices

NO_STOPS: NDArray[np.int64] = np.zeros(0, dtype=np.int64)


class ExplorationExpert:
    """Plans for the cells that are really missing, down to the stopping rule.

    Per map: the true viewpoint graph, what each viewpoint sees, all distances. Per state: a covering tour from the
    robot, then the tour that remains from each waypoint. The tour is the shortest of several, the one kept from the
    last state among them, so that the expert does not waver and its word on a state depends little on chance. A
    viewpoint that the robot has visited shows nothing new, whatever the true map says: so no tour begins where the
    robot stands, and none returns for cells that the sensor cannot resolve.

    Args:
        mapping: lattice and sensor.
        unseen_area: the task's tolerance, square metres.
        starts: fresh covering tours that are tried at the first state of a map; the shortest is kept.
        tries: fresh covering tours that are tried at every other state, beside the kept one.
    """

    def __init__(self, mapping: MappingConfig, unseen_area: float, *, starts: int = 12, tries: int = 3) -> None:
        self._mapping = mapping
        self._unseen_area = unseen_area
        self._starts = starts
        self._tries = tries
        self._world: GridMap | None = None

    def reset(self, world: GridMap) -> None:
        """Prepare for a world: about 100 ms for a public map, a few seconds for a building of 19,000 m2."""
        self._world = world
        self.survey = Survey(world, self._mapping)
        self._distances = self.survey.graph.distances()
        self._tolerance = int(self._unseen_area / world.resolution**2 + 1e-6)
        self._ones = np.ones(len(self._distances))
        self._plan = NO_STOPS
        self._routes: dict[int, NDArray[np.int64]] = {}

    def label(
        self,
        observation: Observation,
        positions: NDArray[np.float64],
        pose: Pose,
        coverage: Coverage,
    ) -> ExpertLabel:
        """Judge the choices of one observation (see `Expert.judge`)."""
        if self._world is None:
            raise HDError("the expert has no map yet: call reset(world) before judge()")
        true_nodes, places = self.survey.graph.match(positions)
        waypoints = observation.waypoint_nodes()
        choices = true_nodes[waypoints]
        robot = int(true_nodes[observation.robot])
        if robot < 0 or len(coverage.unseen_cells) <= self._tolerance:
            return ExpertLabel(np.zeros(len(waypoints), dtype=np.float32), -1, 0.0, coverage.unseen_area)
        # A visited viewpoint of a partly known square can lie where it sees other things than the true one.
        spacing = self._mapping.viewpoint_spacing
        there = np.hypot(*(positions - places).T) <= ON_VIEWPOINT * spacing
        scanned = observation.visited & there & (true_nodes >= 0)
        stops, allowed = self._tour(true_nodes[scanned], robot, coverage)
        if len(stops) == 0:
            # What is missing cannot be seen from any viewpoint: no choice is better than another.
            return ExpertLabel(np.zeros(len(waypoints), dtype=np.float32), -1, 0.0, coverage.unseen_area)
        orders = np.zeros((len(choices), len(stops)), dtype=np.int64)
        sizes = np.zeros(len(choices), dtype=np.int64)
        sight = self.survey.sight
        lengths = price_choices(
            sight.pointer, sight.tile, sight.mask, self.survey.missing, allowed, self._distances, stops, choices,
            self._tolerance, orders, sizes,
        )  # fmt: skip
        legs = leg_lengths(observation, positions, places, pose, spacing)
        total = np.where(np.isfinite(lengths), legs + lengths, np.inf)
        best = int(np.argmin(total))
        remaining = float(total[best])
        if not np.isfinite(remaining):
            return ExpertLabel(np.zeros(len(waypoints), dtype=np.float32), -1, UNREACHABLE, coverage.unseen_area)
        self._plan = stops
        self._routes = {int(v): orders[c, : sizes[c]].copy() for c, v in enumerate(choices) if v >= 0}
        cost = np.minimum(total - remaining, UNREACHABLE).astype(np.float32)
        beacon = self._first_beacon(observation, true_nodes, int(choices[best]), stops, orders[best, : sizes[best]])
        return ExpertLabel(cost, beacon, remaining, coverage.unseen_area)

    def _tour(
        self, scanned: NDArray[np.int64], robot: int, coverage: Coverage
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return a short covering tour from the robot, and which viewpoints can show something new."""
        survey, distances = self.survey, self._distances
        survey.note(coverage)
        sight, missing = survey.sight, survey.missing
        allowed = np.isfinite(distances[robot])
        allowed[scanned] = False
        allowed[robot] = False
        gains = cover.count_gains(sight.pointer, sight.tile, sight.mask, missing, allowed)

        def plan(kept: NDArray[np.int64], weights: NDArray[np.float64]) -> NDArray[np.int64]:
            return cover.plan_cover(
                sight.pointer, sight.tile, sight.mask, missing, allowed, distances, robot, gains.copy(),
                weights, kept, self._tolerance, 6,
            )  # fmt: skip

        fresh = plan(NO_STOPS, self._ones)
        candidates = [fresh]
        previous = self._routes.get(robot, self._plan)
        kept = previous[allowed[previous] & (gains[previous] > 0)]
        if len(kept):
            candidates.insert(0, plan(kept, self._ones))
        # Other tours from perturbed gains; the source of chance is the state's own, so that they repeat.
        rng = np.random.default_rng([robot, len(coverage.unseen_cells), len(scanned)])
        tries = self._tries if self._routes else self._starts
        candidates += [plan(NO_STOPS, np.exp(rng.normal(0.0, 0.4, len(gains)))) for _ in range(tries - 1)]
        lengths = [tour_length(distances, robot, stops) for stops in candidates]
        return candidates[int(np.argmin(lengths))], allowed

    def _first_beacon(
        self,
        observation: Observation,
        true_nodes: NDArray[np.int64],
        choice: int,
        stops: NDArray[np.int64],
        order: NDArray[np.int64],
    ) -> int:
        """Return the beacon nearest to the first stop of the best route, -1 without beacons."""
        beacons = observation.beacon_nodes()
        known = beacons[true_nodes[beacons] >= 0]
        if len(known) == 0:
            return -1
        first = choice if choice in stops or len(order) == 0 else int(order[0])
        return int(known[np.argmin(self._distances[first, true_nodes[known]])])


def make_expert(task: TaskConfig, mapping: MappingConfig) -> ExplorationExpert:
    """Return the expert that `common.tasks.EXPLORATION` names."""
    return ExplorationExpert(mapping, task.unseen_area)
