"""Where a robot may decide on the true map: its start and all viewpoints, with the shortest paths between them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from actors.expert.true_graph import TrueGraph
from actors.maps.grid_map import GridMap
from common.config import MappingConfig
from common.mapping.viewpoints import LONGEST_EDGE
from common.planners.base import Position
from common.planners.viewpoint_planner import TOLERANCE
from common.system.jit import njit


@njit(cache=True, nogil=True)
def _next_hops(
    pointer: NDArray[np.int64],
    neighbours: NDArray[np.int32],
    lengths: NDArray[np.float64],
    distances: NDArray[np.float32],
) -> NDArray[np.int32]:
    """Return the neighbour to go to from every viewpoint towards every other, int32, shape (n, n); -1 at itself."""
    n = len(distances)
    hops = np.full((n, n), -1, dtype=np.int32)
    best = np.empty(n)
    for a in range(n):
        best[:] = np.inf
        for k in range(pointer[a], pointer[a + 1]):
            u = neighbours[k]
            for b in range(n):
                length = lengths[k] + distances[u, b]
                if length < best[b] - 1e-4:
                    best[b] = length
                    hops[a, b] = u
        hops[a, a] = -1
    return hops


@dataclass(frozen=True, slots=True, eq=False)
class RouteGraph:
    """Viewpoints of the true map and the robot's start, with all shortest ways between them.

    Attributes:
        graph: the viewpoints and their edges.
        points: of all nodes in cell coordinates (x, y), float64, shape (m, 2); the viewpoints first.
        start: node number of the start: a viewpoint when it lies on one, the last node otherwise.
        distances: metres, float32, shape (m, m), inf without a way; no way leads back to a start beside its viewpoint.
        hops: next node from every node towards every other, int32, shape (m, m), -1 without a way.
    """

    graph: TrueGraph
    points: NDArray[np.float64]
    start: int
    distances: NDArray[np.float32]
    hops: NDArray[np.int32]
    _start_position: Position

    @classmethod
    def build(cls, world: GridMap, mapping: MappingConfig) -> RouteGraph:
        """Find viewpoints, edges and shortest ways; MapError when the robot does not fit at the start."""
        graph = TrueGraph.build(world, mapping)
        n, home = len(graph), graph.mapper.robot
        distances = graph.distances()
        hops = _next_hops(graph.pointer, graph.neighbours, graph.lengths, distances)
        away = np.hypot(*(graph.positions - world.start).T)
        if away[home] <= TOLERANCE:
            return cls(graph, graph.points, home, distances, hops, world.start)
        near = np.argsort(away, kind="stable")
        near = near[away[near] <= LONGEST_EDGE * mapping.viewpoint_spacing + TOLERANCE]
        in_line = [v for v in near.tolist() if graph.mapper.segment_free(world.start, graph.mapper.position(v))]
        links = np.array(in_line if home in in_line else [*in_line, home])
        legs = np.where(links == home, _length([world.start, *graph.mapper.way_home()]), away[links])
        ways = legs[:, None] + distances[links]
        first = np.argmin(ways, axis=0)
        all_distances = np.full((n + 1, n + 1), np.inf, dtype=np.float32)
        all_hops = np.full((n + 1, n + 1), -1, dtype=np.int32)
        all_distances[:n, :n], all_hops[:n, :n] = distances, hops
        all_distances[n, :n] = ways[first, np.arange(n)]
        all_distances[n, n] = 0.0
        all_hops[n, :n] = links[first]
        (x, y), resolution = world.origin, world.resolution
        start = ((world.start[0] - x) / resolution, (world.start[1] - y) / resolution)
        return cls(graph, np.vstack([graph.points, start]), n, all_distances, all_hops, world.start)

    def __len__(self) -> int:
        return len(self.points)

    def position(self, node: int) -> Position:
        """Return the position of a node, metres."""
        return self.graph.mapper.position(node) if node < len(self.graph) else self._start_position

    def way(self, a: int, b: int) -> list[Position]:
        """Return where to drive from a node to the next one: the corners of the way and that node, metres."""
        mapper = self.graph.mapper
        if a < len(self.graph):
            return mapper.way(a, b)
        return mapper.way_home() if b == mapper.robot else [mapper.position(b)]

    def route(self, stops: Iterable[int]) -> list[int]:
        """Return all nodes on the shortest way from the start through stops, the start excluded."""
        return self.route_from(self.start, stops)

    def legs(self, nodes: list[int]) -> list[list[Position]]:
        """Return where to drive from the start along a route, edge by edge; see `way`."""
        return [self.way(a, b) for a, b in pairwise([self.start, *nodes])]

    def route_from(self, node: int, stops: Iterable[int]) -> list[int]:
        """Return all nodes on the shortest way from a node through stops, that node excluded."""
        nodes, at = [], node
        for stop in stops:
            while at != stop:
                at = int(self.hops[at, stop])
                nodes.append(at)
        return nodes


def _length(positions: list[Position]) -> float:
    return float(np.hypot(*np.diff(np.array(positions), axis=0).T).sum())
