"""The omniscient reference: what a robot would drive that knew the map. It is no planner, and is never one's rival."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from actors.evaluation.annealing import anneal, drive
from actors.evaluation.retrace import follow
from actors.evaluation.true_graph import TrueGraph, lattice_links
from actors.expert.lattice import line_free
from actors.expert.visibility import fill_words, look_from_all
from actors.maps.grid_map import GridMap
from actors.tasks import make_task
from actors.tasks.coverage import Coverage
from common.config.schema import MappingConfig, SimulatorConfig, TaskConfig
from common.errors import MapError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Plan, Position, Status, TaskName
from common.planners.lattice import LONGEST_EDGE, TOLERANCE
from common.tours import cover
from common.tours.sighting import Visibility

log = logging.getLogger(__name__)

NAME = "omniscient"
# What a scan shows depends a little on the heading, so tours are also made that leave fewer cells unseen than allowed.
MARGINS = (0, 10, 40, 125)
ITERATIONS = 30_000
TRIES = 3
GREEDY_STARTS = 12
HOTTEST, COLDEST = 8.0, 0.3
NEAR_NODES = 16
_NO_STOPS: NDArray[np.int64] = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """What came of driving a route in the grid simulator.

    Attributes:
        driven: number of positions that were driven to; the task was complete there, or the route ended.
        complete: the task was complete.
        length: metres.
        unseen: cells of the true map that are still unseen.
    """

    driven: int
    complete: bool
    length: float
    unseen: NDArray[np.int64]


class OmniscientReference:
    """Drives the shortest route that it finds on the known map, under the same rules as every planner.

    Exploration: a set cover of viewpoints, an open tour through them, and simulated annealing on the exact length
    until enough has been seen; tours are rehearsed in the grid simulator and the shortest complete one is taken. It
    is near the optimum and no bound: another route may still be a little shorter. Navigation: the shortest path over
    the viewpoints of the true map, exactly.

    Usage::

        reference.prepare(world, seed)
        reference.reset(task, target, seed)
        plan = reference.plan(mapper, pose)
    """

    name = NAME
    tasks: frozenset[TaskName] = frozenset({"exploration", "navigation"})

    def __init__(
        self, mapping: MappingConfig, task: TaskConfig, simulator: SimulatorConfig, *, iterations: int = ITERATIONS
    ) -> None:
        """Set up.

        Args:
            mapping: lattice and sensor.
            task: what is to be done, and when it is complete.
            simulator: beams and noise of the sensor; tours are always rehearsed in the grid simulator.
            iterations: changes that the annealing tries for each tour.
        """
        self._mapping = mapping
        self._task = task
        self._simulator = simulator.model_copy(update={"name": "grid"})
        self._iterations = iterations
        self._route: list[Position] = []
        self._driven = 0

    def prepare(self, world: GridMap, seed: int) -> None:
        """Look at the true map and find the route; takes a second or two for exploration.

        Raises:
            MapError: no viewpoint, or no way to the target.
        """
        graph = TrueGraph.build(world, self._mapping.viewpoint_spacing)
        find = self._shortest_path if self._task.name == "navigation" else self._covering_tour
        self._route = find(world, graph, seed)

    def reset(self, task: TaskName, target: Position | None, seed: int) -> None:
        """Begin the route that was prepared."""
        del task, target, seed
        self._driven = 0

    def plan(self, mapper: Mapper, pose: Pose) -> Plan:
        """Return the next position of the route."""
        del mapper, pose
        if self._driven >= len(self._route):
            return Plan(Status.COMPLETE, reason="the route on the known map has ended")
        self._driven += 1
        ahead = self._route[self._driven - 1 :]
        return Plan(Status.GOING, waypoint=ahead[0], path=ahead[1:])

    def _shortest_path(self, world: GridMap, graph: TrueGraph, seed: int) -> list[Position]:
        """Return the shortest way over viewpoints to where the robot has arrived."""
        del seed
        task = make_task(self._task)
        task.reset(world)
        target = world.target
        coverage = Coverage(world)
        assert target is not None
        if task.complete(coverage, Pose(*world.start)):
            return []
        arrived = [v for v in range(len(graph)) if task.complete(coverage, Pose(*graph.position(v)))]
        links, legs = lattice_links(world, graph.lattice, target)
        last_leg = np.full(len(graph), np.inf)
        last_leg[links] = legs
        last_leg[arrived] = 0.0
        lengths = graph.distances[graph.start] + last_leg
        best = int(np.argmin(lengths))
        direct = float(np.hypot(target[0] - world.start[0], target[1] - world.start[1]))
        reach = LONGEST_EDGE * self._mapping.viewpoint_spacing + TOLERANCE
        if direct <= min(reach, float(lengths[best])) and _in_sight(world, world.start, target):
            return [target]
        if not np.isfinite(lengths[best]):
            raise MapError(f"map {world.name!r}: no way over viewpoints leads from the start to the target")
        route = [graph.position(node) for node in graph.route([best])]
        return route if last_leg[best] == 0.0 else [*route, target]

    def _covering_tour(self, world: GridMap, graph: TrueGraph, seed: int) -> list[Position]:
        """Return the shortest tour found that sees enough when it is driven."""
        reach = self._mapping.sensor_range / world.resolution
        sight = look_from_all(world.free, graph.points, reach, self._simulator.rays)
        tolerance = int(self._task.unseen_area / world.resolution**2 + 1e-6)
        unseen = self._rehearse(world, [], seed).unseen
        if len(unseen) <= tolerance:
            return []
        best: list[Position] = []
        route: list[Position] = []
        shortest = np.inf
        for margin in MARGINS:
            for stops in self._tours(world, graph, sight, unseen, max(tolerance - margin, 0)):
                route = [graph.position(node) for node in graph.route(stops)]
                rehearsal = self._rehearse(world, route, seed)
                if rehearsal.complete and rehearsal.length < shortest:
                    best, shortest = route[: rehearsal.driven], rehearsal.length
            if best:
                return best
        return self._extend(world, graph, sight, route, tolerance, seed)

    def _tours(
        self, world: GridMap, graph: TrueGraph, sight: Visibility, unseen: NDArray[np.int64], tolerance: int
    ) -> list[list[int]]:
        """Return a few short covering tours as lists of stops."""
        missing = np.zeros(sight.tiles, dtype=np.uint64)
        fill_words(unseen, world.free.shape[1], missing)
        allowed = np.isfinite(graph.distances[graph.start])
        allowed[graph.start] = False
        gains = cover.count_gains(sight.pointer, sight.tile, sight.mask, missing, allowed)
        useful = np.flatnonzero(gains)
        if not len(useful):
            return []
        random = np.random.default_rng(len(unseen))
        weights = [np.ones(len(graph))]
        weights += [np.exp(random.normal(0.0, 0.4, len(graph))) for _ in range(GREEDY_STARTS - 1)]
        covers = [
            cover.plan_cover(
                sight.pointer, sight.tile, sight.mask, missing, allowed, graph.distances, graph.start, gains.copy(),
                weight, _NO_STOPS, tolerance, 6,
            )
            for weight in weights
        ]  # fmt: skip
        rest, passed = np.empty_like(missing), np.zeros(len(graph), dtype=np.int64)
        lengths = [
            drive(
                sight.pointer, sight.tile, sight.mask, graph.distances, graph.hops, graph.start, stops, len(stops),
                missing, len(unseen), tolerance, np.inf, rest, passed, number + 1,
            )[0]
            for number, stops in enumerate(covers)
        ]  # fmt: skip
        near = _near_nodes(graph)
        tours = []
        for number in np.argsort(lengths, kind="stable")[:TRIES]:
            stops, length = anneal(
                sight.pointer, sight.tile, sight.mask, graph.distances, graph.hops, graph.start, covers[number],
                missing, len(unseen), tolerance, useful, near, self._iterations, HOTTEST, COLDEST, int(number),
            )  # fmt: skip
            tours.append((length, stops.tolist()))
        return [stops for _, stops in sorted(tours)]

    def _extend(
        self, world: GridMap, graph: TrueGraph, sight: Visibility, route: list[Position], tolerance: int, seed: int
    ) -> list[Position]:
        """Go on from the end of a route to viewpoints that still show something, as long as there are any."""
        nodes = {graph.position(node): node for node in range(len(graph))}
        missing = np.zeros(sight.tiles, dtype=np.uint64)
        while True:
            rehearsal = self._rehearse(world, route, seed)
            if rehearsal.complete:
                return route[: rehearsal.driven]
            fill_words(rehearsal.unseen, world.free.shape[1], missing)
            at = nodes[route[-1]] if route else graph.start
            allowed = np.isfinite(graph.distances[at])
            allowed[[nodes[position] for position in route] + [graph.start]] = False
            gains = cover.count_gains(sight.pointer, sight.tile, sight.mask, missing, allowed)
            stops = cover.plan_cover(
                sight.pointer, sight.tile, sight.mask, missing, allowed, graph.distances, at, gains.copy(),
                np.ones(len(graph)), _NO_STOPS, tolerance, 6,
            )  # fmt: skip
            if not len(stops):
                log.warning("map %r: %d cells cannot be seen from any viewpoint", world.name, len(rehearsal.unseen))
                return route
            for stop in stops.tolist():
                while at != stop:
                    at = int(graph.hops[at, stop])
                    route = [*route, graph.position(at)]

    def _rehearse(self, world: GridMap, route: list[Position], seed: int) -> Rehearsal:
        """Drive a route in the grid simulator, with the scans that an episode of this seed has."""
        for moment in follow(world, [world.start, *route], self._mapping, self._simulator, seed=seed):
            unseen = moment.coverage.unseen_cells
            if not (moment.known and moment.clear):
                return Rehearsal(moment.number - 1, False, moment.distance, unseen)
            if moment.coverage.unseen_area <= self._task.unseen_area + 1e-9:
                return Rehearsal(moment.number, True, moment.distance, unseen)
        return Rehearsal(moment.number, False, moment.distance, unseen)


def _near_nodes(graph: TrueGraph) -> NDArray[np.int64]:
    """Return the nodes nearest to each node by the way there, shape (nodes, any); a node itself where there are few."""
    count = min(NEAR_NODES, len(graph) - 1)
    ways = graph.distances.copy()
    np.fill_diagonal(ways, np.inf)
    nearest = np.argsort(ways, axis=1, kind="stable")[:, : max(count, 1)].astype(np.int64)
    reachable = np.isfinite(np.take_along_axis(ways, nearest, axis=1))
    return np.where(reachable, nearest, np.arange(len(graph))[:, None])


def _in_sight(world: GridMap, a: Position, b: Position) -> bool:
    (x, y), resolution = world.origin, world.resolution
    cells = [(p - q) / resolution for point in (a, b) for p, q in zip(point, (x, y), strict=True)]
    return bool(line_free(np.ascontiguousarray(world.free), *cells))
