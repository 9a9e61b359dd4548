"""The omniscient reference: the route of a robot that knows the map. It is a yardstick, not a planner."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from actors.evaluation.annealing import anneal, drive
from actors.evaluation.rehearsal import Leg, Rehearsals, known_part
from actors.evaluation.route_graph import RouteGraph
from actors.expert.visibility import fill_words, look_from_all
from actors.maps.grid_map import GridMap
from actors.tasks import make_goal
from actors.tasks.coverage import Coverage
from common.config import MappingConfig, SimulatorConfig, TaskConfig
from common.errors import MapError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.viewpoints import LONGEST_EDGE
from common.planners.base import Plan, Position, Status, TaskName
from common.planners.exploration.greedy import GreedyPlanner
from common.planners.exploration.nearest import NearestPlanner
from common.planners.viewpoint_planner import TOLERANCE
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
# Metres that the annealing counts for a cell that stays unseen: more where the first lets it skip rooms in the end.
CELL_PENALTIES = (0.02, 0.2, 2.0)
NEAR_NODES = 16
_NO_STOPS: NDArray[np.int64] = np.zeros(0, dtype=np.int64)


class OmniscientReference:
    """Drives the shortest route that it finds on the known map, under the same rules as every planner.

    Exploration: a set cover of viewpoints, an open tour through them, and simulated annealing on the exact length
    until enough has been seen; tours are rehearsed in the grid simulator, as are the routes of two planners that do
    not know the map, and the shortest complete one is taken. It is near the optimum and no bound: another route may
    still be a little shorter. Navigation: the shortest path over the viewpoints of the true map, exactly.

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
        self._simulator = simulator
        self._rehearsals = Rehearsals(mapping, task, simulator)
        self._iterations = iterations
        self._route: list[Leg] = []
        self._ahead: list[Leg] = []

    def prepare(self, world: GridMap, seed: int) -> None:
        """Look at the true map and find the route: a second or two for exploration, minutes for a large building.

        Raises:
            MapError: the robot does not fit at the start, or no way leads to the target.
        """
        graph = RouteGraph.build(world, self._mapping)
        find = self._shortest_path if self._task.kind.needs_target else self._covering_tour
        self._route = find(world, graph, seed)

    def reset(self, task: TaskName, target: Position | None, seed: int) -> None:
        """Begin the route that was prepared."""
        del task, target, seed
        self._ahead = list(self._route)

    def plan(self, mapper: Mapper, pose: Pose) -> Plan:
        """Return the next leg of the route, or as much of it as the robot knows to be free."""
        if not self._ahead:
            return Plan(Status.COMPLETE, reason="the route on the known map has ended")
        leg, rest = known_part(mapper, pose.position, self._ahead.pop(0))
        if rest:
            self._ahead.insert(0, rest)
        return Plan(Status.GOING, waypoint=leg[-1], via=leg[:-1], path=[ahead[-1] for ahead in self._ahead])

    def _shortest_path(self, world: GridMap, graph: RouteGraph, seed: int) -> list[Leg]:
        """Return the shortest way over viewpoints to where the robot has arrived."""
        del seed
        goal = make_goal(self._task)
        goal.reset(world)
        target = world.target
        coverage = Coverage(world, self._mapping.robot_radius)
        assert target is not None
        if goal.complete(coverage, Pose(*world.start)):
            return []
        arrived = [v for v in range(len(graph)) if goal.complete(coverage, Pose(*graph.position(v)))]
        links, lengths = graph.graph.target_links()
        last_leg = np.full(len(graph), np.inf)
        last_leg[links] = lengths
        last_leg[arrived] = 0.0
        totals = graph.distances[graph.start] + last_leg
        best = int(np.argmin(totals))
        direct = float(np.hypot(target[0] - world.start[0], target[1] - world.start[1]))
        reach = LONGEST_EDGE * self._mapping.viewpoint_spacing + TOLERANCE
        mapper = graph.graph.mapper
        if direct <= min(reach, float(totals[best])) and mapper.segment_free(world.start, target):
            return [[target]]
        if not np.isfinite(totals[best]):
            raise MapError(
                f"map {world.name!r}: no way over viewpoints leads from the start to the target for a robot of radius "
                f"{self._mapping.robot_radius:g} m: move one of the two, or use a smaller mapping.robot_radius"
            )
        route = graph.legs(graph.route([best]))
        if last_leg[best] == 0.0:
            return route
        way = mapper.way(best, len(graph.graph))
        # A target nearer to a wall than the robot fits: it goes as near as that.
        before = [graph.position(best), *way][-2]
        last = way if mapper.segment_free(before, target) else way[:-1]
        return [*route, last] if last else route

    def _covering_tour(self, world: GridMap, graph: RouteGraph, seed: int) -> list[Leg]:
        """Return the shortest tour found that sees enough when it is driven."""
        reach = self._mapping.sensor_range / world.resolution
        sight = look_from_all(world.free, graph.points, reach, self._simulator.rays)
        tolerance = int(self._task.unseen_area / world.resolution**2 + 1e-6)
        unseen = self._rehearsals.of_route(world, [], seed).unseen
        if len(unseen) <= tolerance:
            return []
        best: list[Leg] = []
        nodes: list[int] = []
        shortest = np.inf
        for margin in MARGINS:
            for stops in self._tours(world, graph, sight, unseen, max(tolerance - margin, 0)):
                nodes = graph.route(stops)
                rehearsal = self._rehearsals.of_route(world, graph.legs(nodes), seed)
                if rehearsal.complete and rehearsal.length < shortest:
                    best, shortest = rehearsal.legs, rehearsal.length
            if best:
                break
        # A robot that gets to know the world on its way has other viewpoints, which may be better ones.
        for planner in (NearestPlanner(self._mapping), GreedyPlanner(self._mapping)):
            rehearsal = self._rehearsals.of_planner(world, planner, seed)
            if rehearsal.complete and rehearsal.length < shortest:
                best, shortest = rehearsal.legs, rehearsal.length
        return best or self._extend(world, graph, sight, nodes, tolerance, seed)

    def _tours(
        self, world: GridMap, graph: RouteGraph, sight: Visibility, unseen: NDArray[np.int64], tolerance: int
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
                missing, len(unseen), tolerance, CELL_PENALTIES[0], np.inf, rest, passed, number + 1,
            )[0]
            for number, stops in enumerate(covers)
        ]  # fmt: skip
        near = _near_nodes(graph)
        tours = []
        for number in np.argsort(lengths, kind="stable")[:TRIES]:
            stops = covers[number]
            for penalty in CELL_PENALTIES:
                stops, length, finished = anneal(
                    sight.pointer, sight.tile, sight.mask, graph.distances, graph.hops, graph.start, stops, missing,
                    len(unseen), tolerance, useful, near, self._iterations, HOTTEST, COLDEST, penalty, int(number),
                )  # fmt: skip
                if finished:
                    break
            tours.append((length, stops.tolist()))
        return [stops for _, stops in sorted(tours)]

    def _extend(
        self, world: GridMap, graph: RouteGraph, sight: Visibility, nodes: list[int], tolerance: int, seed: int
    ) -> list[Leg]:
        """Go on from the end of a route to viewpoints that still show something, as long as there are any."""
        missing = np.zeros(sight.tiles, dtype=np.uint64)
        while True:
            rehearsal = self._rehearsals.of_route(world, graph.legs(nodes), seed)
            if rehearsal.complete:
                return rehearsal.legs
            fill_words(rehearsal.unseen, world.free.shape[1], missing)
            at = nodes[-1] if nodes else graph.start
            allowed = np.isfinite(graph.distances[at])
            allowed[[*nodes, graph.start]] = False
            gains = cover.count_gains(sight.pointer, sight.tile, sight.mask, missing, allowed)
            stops = cover.plan_cover(
                sight.pointer, sight.tile, sight.mask, missing, allowed, graph.distances, at, gains.copy(),
                np.ones(len(graph)), _NO_STOPS, tolerance, 6,
            )  # fmt: skip
            if not len(stops):
                log.warning("map %r: %d cells cannot be seen from any viewpoint", world.name, len(rehearsal.unseen))
                return rehearsal.legs
            nodes = [*nodes, *graph.route_from(at, stops.tolist())]


def _near_nodes(graph: RouteGraph) -> NDArray[np.int64]:
    """Return the nodes nearest to each node by the way there, shape (nodes, any); a node itself where there are few."""
    count = max(min(NEAR_NODES, len(graph) - 1), 1)
    near = np.empty((len(graph), count), dtype=np.int64)
    # Row by row: the order of all nodes from all others would take twice the memory of the distances.
    for node, row in enumerate(graph.distances):
        ways = row.copy()
        ways[node] = np.inf
        nearest = np.argsort(ways, kind="stable")[:count]
        near[node] = np.where(np.isfinite(ways[nearest]), nearest, node)
    return near
