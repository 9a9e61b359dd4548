"""The graph of all places on the true map where a robot may decide: its start, the viewpoints, and the target."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from actors.expert.lattice import TrueLattice, line_free
from actors.maps.grid_map import GridMap
from common.errors import MapError
from common.jit import njit
from common.mapping.viewpoints import LONGEST_EDGE
from common.observation import NEIGHBOUR_OFFSETS
from common.planners.lattice import TOLERANCE

# Two edges of one spacing go the way of one of two spacings, and the robot sees more on it.
_DOUBLE = np.gcd(np.abs(NEIGHBOUR_OFFSETS[:, 0]), np.abs(NEIGHBOUR_OFFSETS[:, 1])) > 1


@njit(cache=True, nogil=True)
def _next_hops(
    table: NDArray[np.int32], lengths: NDArray[np.float64], distances: NDArray[np.float32]
) -> NDArray[np.int32]:
    """Return the neighbour to go to from every viewpoint towards every other, int32, shape (n, n); -1 without a way."""
    n, degree = table.shape
    hops = np.full((n, n), -1, dtype=np.int32)
    for a in range(n):
        for b in range(n):
            if a == b or not np.isfinite(distances[a, b]):
                continue
            best = np.inf
            for k in range(degree):
                u = table[a, k]
                if u >= 0:
                    length = lengths[k] + distances[u, b]
                    if length < best - 1e-4:
                        best = length
                        hops[a, b] = u
    return hops


@dataclass(frozen=True, slots=True, eq=False)
class TrueGraph:
    """Viewpoints of the true map and the robot's start, with all shortest ways between them.

    Attributes:
        lattice: the viewpoints, without edges of two spacings.
        points: of all nodes in cell coordinates (x, y), float64, shape (m, 2); the viewpoints first.
        start: node number of the start: a viewpoint when it lies on one, the last node otherwise.
        distances: metres, float32, shape (m, m), inf without a way; no way leads back to a start beside the lattice.
        hops: next node from every node towards every other, int32, shape (m, m), -1 without a way.
    """

    lattice: TrueLattice
    points: NDArray[np.float64]
    start: int
    distances: NDArray[np.float32]
    hops: NDArray[np.int32]
    _frame: tuple[tuple[float, float], float]

    @classmethod
    def build(cls, world: GridMap, spacing: float) -> TrueGraph:
        """Find viewpoints, edges and shortest ways; MapError when no viewpoint can be reached from the start."""
        lattice = TrueLattice.build(world, spacing)
        lattice = replace(lattice, table=np.where(_DOUBLE, np.int32(-1), lattice.table))
        frame = (world.origin, world.resolution)
        n = len(lattice)
        distances = lattice.distances()
        hops = _next_hops(lattice.table, lattice.lengths, distances)
        links, legs = lattice_links(world, lattice, world.start)
        if not len(links):
            raise MapError(f"map {world.name!r}: no viewpoint can be reached from the start {world.start}")
        if legs[0] <= TOLERANCE:
            return cls(lattice, lattice.points, int(links[0]), distances, hops, frame)
        ways = legs[:, None] + distances[links]
        first = np.argmin(ways, axis=0)
        all_distances = np.full((n + 1, n + 1), np.inf, dtype=np.float32)
        all_hops = np.full((n + 1, n + 1), -1, dtype=np.int32)
        all_distances[:n, :n], all_hops[:n, :n] = distances, hops
        all_distances[n, :n] = ways[first, np.arange(n)]
        all_distances[n, n] = 0.0
        all_hops[n, :n] = np.where(np.isfinite(all_distances[n, :n]), links[first], -1)
        start = _cells(world, world.start)
        return cls(lattice, np.vstack([lattice.points, start]), n, all_distances, all_hops, frame)

    def __len__(self) -> int:
        return len(self.points)

    def position(self, node: int) -> tuple[float, float]:
        """Return the position of a node, metres."""
        (x, y), resolution = self._frame
        return float(x + self.points[node, 0] * resolution), float(y + self.points[node, 1] * resolution)

    def route(self, stops: list[int]) -> list[int]:
        """Return all nodes on the shortest way from the start through stops, the start excluded."""
        nodes, at = [], self.start
        for stop in stops:
            while at != stop:
                at = int(self.hops[at, stop])
                nodes.append(at)
        return nodes


def lattice_links(
    world: GridMap, lattice: TrueLattice, position: tuple[float, float]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the viewpoints that a position can be joined to by one free edge, nearest first, and their metres."""
    x, y = _cells(world, position)
    metres = np.hypot(lattice.points[:, 0] - x, lattice.points[:, 1] - y) * world.resolution
    free = np.ascontiguousarray(world.free)
    near = np.flatnonzero(metres <= LONGEST_EDGE * lattice.spacing + TOLERANCE)
    near = near[np.argsort(metres[near], kind="stable")]
    seen = [int(v) for v in near if line_free(free, x, y, lattice.points[v, 0], lattice.points[v, 1])]
    links = np.array(seen, dtype=np.int64)
    return links, metres[links]


def _cells(world: GridMap, position: tuple[float, float]) -> tuple[float, float]:
    x, y = world.origin
    return (position[0] - x) / world.resolution, (position[1] - y) / world.resolution
