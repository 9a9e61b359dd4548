"""The viewpoint graph of the true map, with the distances between all its viewpoints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from actors.maps.grid_map import GridMap
from common.heap import pop, push
from common.jit import njit
from common.observation import NEIGHBOUR_COUNT, NEIGHBOUR_OFFSETS, Observation

EPSILON = 1e-6


@njit(cache=True, nogil=True)
def line_free(free: NDArray[np.bool_], x0: float, y0: float, x1: float, y1: float) -> bool:
    """Whether every cell that a segment touches is free; coordinates in cells, outside counts as occupied.

    Touching is meant in the closed sense, with a tolerance of 1e-6 cells: a segment along a cell border or through a
    corner touches the cells on both sides. So the answer is the same from either end.
    """
    rows, columns = free.shape
    low_x, high_x = min(x0, x1), max(x0, x1)
    dx = x1 - x0
    dy = y1 - y0
    for c in range(int(np.floor(low_x - EPSILON)), int(np.floor(high_x + EPSILON)) + 1):
        # The part of the segment whose x lies within this column, and the rows that it spans there.
        if abs(dx) < EPSILON:
            ya, yb = y0, y1
        else:
            ta = (max(c - EPSILON, low_x) - x0) / dx
            tb = (min(c + 1.0 + EPSILON, high_x) - x0) / dx
            ya = y0 + dy * min(max(ta, 0.0), 1.0)
            yb = y0 + dy * min(max(tb, 0.0), 1.0)
        first = int(np.floor(min(ya, yb) - EPSILON))
        last = int(np.floor(max(ya, yb) + EPSILON))
        for r in range(first, last + 1):
            if r < 0 or r >= rows or c < 0 or c >= columns or not free[r, c]:
                return False
    return True


@njit(cache=True, nogil=True)
def _edges(
    free: NDArray[np.bool_],
    index: NDArray[np.int32],
    points: NDArray[np.float64],
    sites: NDArray[np.int32],
    offsets: NDArray[np.int16],
) -> NDArray[np.int32]:
    """Neighbour table (n, 20) of the viewpoints in line of sight, -1 where there is none."""
    n = len(points)
    table = np.full((n, len(offsets)), -1, dtype=np.int32)
    height, width = index.shape
    last = len(offsets) - 1
    for v in range(n):
        for k in range(len(offsets) // 2):
            j = sites[v, 1] + offsets[k, 1]
            i = sites[v, 0] + offsets[k, 0]
            if i < 0 or j < 0 or i >= width or j >= height:
                continue
            u = index[j, i]
            if u >= 0 and line_free(free, points[v, 0], points[v, 1], points[u, 0], points[u, 1]):
                table[v, k] = u
                table[u, last - k] = v
    return table


@njit(cache=True, nogil=True)
def shortest_distances(
    table: NDArray[np.int32], lengths: NDArray[np.float64], sources: NDArray[np.int64], seeds: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Dijkstra from a set of sources with given initial distances; metres, inf where there is no way."""
    n, degree = table.shape
    best = np.full(n, np.inf)
    done = np.zeros(n, dtype=np.bool_)
    capacity = n * degree + len(sources) + 1
    heap_key = np.empty(capacity)
    heap_node = np.empty(capacity, dtype=np.int64)
    size = 0
    for s in range(len(sources)):
        if seeds[s] < best[sources[s]]:
            best[sources[s]] = seeds[s]
            size = push(heap_key, heap_node, size, seeds[s], sources[s])
    while size:
        node = heap_node[0]
        key = heap_key[0]
        size = pop(heap_key, heap_node, size)
        if done[node] or key > best[node]:
            continue
        done[node] = True
        for k in range(degree):
            u = table[node, k]
            if u >= 0 and not done[u]:
                candidate = key + lengths[k]
                if candidate < best[u]:
                    best[u] = candidate
                    size = push(heap_key, heap_node, size, candidate, u)
    return best.astype(np.float32)


@njit(cache=True, nogil=True)
def _all_pairs(table: NDArray[np.int32], lengths: NDArray[np.float64]) -> NDArray[np.float32]:
    n = len(table)
    distances = np.empty((n, n), dtype=np.float32)
    source = np.zeros(1, dtype=np.int64)
    seed = np.zeros(1)
    for v in range(n):
        source[0] = v
        distances[v] = shortest_distances(table, lengths, source, seed)
    return distances


@dataclass(frozen=True, slots=True, eq=False)
class TrueLattice:
    """All viewpoints of a true map that connect with the start, and their graph.

    Attributes:
        first: lattice numbers (i, j) of ``index[0, 0]``, counted from the map's lattice origin.
        index: viewpoint number per lattice site, int32, shape (height, width), -1 where there is none.
        points: viewpoints in cell coordinates (x, y), float64, shape (n, 2).
        table: neighbours, int32, shape (n, 20), -1 where there is none.
        lengths: metres of the 20 edges, float64, shape (20,).
    """

    first: tuple[int, int]
    index: NDArray[np.int32]
    points: NDArray[np.float64]
    table: NDArray[np.int32]
    lengths: NDArray[np.float64]
    spacing: float
    origin: tuple[float, float]

    @classmethod
    def build(cls, world: GridMap, spacing: float) -> TrueLattice:
        """Find the viewpoints of a world and their edges; the lattice is the one that the robot uses."""
        free = np.ascontiguousarray(world.free)
        rows, columns = free.shape
        step = spacing / world.resolution
        x0 = (world.lattice_origin[0] - world.origin[0]) / world.resolution
        y0 = (world.lattice_origin[1] - world.origin[1]) / world.resolution
        i_first, i_last = int(np.ceil(-x0 / step - EPSILON)), int(np.floor((columns - x0) / step + EPSILON))
        j_first, j_last = int(np.ceil(-y0 / step - EPSILON)), int(np.floor((rows - y0) / step + EPSILON))
        xs = x0 + step * np.arange(i_first, i_last + 1)
        ys = y0 + step * np.arange(j_first, j_last + 1)
        cell_x = np.floor(xs + EPSILON).astype(np.int64)
        cell_y = np.floor(ys + EPSILON).astype(np.int64)
        inside = ((cell_y >= 0) & (cell_y < rows))[:, None] & ((cell_x >= 0) & (cell_x < columns))[None, :]
        is_free = inside & free[np.clip(cell_y, 0, rows - 1)[:, None], np.clip(cell_x, 0, columns - 1)[None, :]]
        index = np.full(is_free.shape, -1, dtype=np.int32)
        j, i = np.nonzero(is_free)
        index[j, i] = np.arange(len(i), dtype=np.int32)
        points = np.ascontiguousarray(np.stack([xs[i], ys[j]], axis=1))
        sites = np.ascontiguousarray(np.stack([i, j], axis=1).astype(np.int32))
        table = _edges(free, index, points, sites, NEIGHBOUR_OFFSETS)
        lengths = spacing * np.hypot(NEIGHBOUR_OFFSETS[:, 0], NEIGHBOUR_OFFSETS[:, 1]).astype(np.float64)
        return cls((i_first, j_first), index, points, table, lengths, spacing, world.lattice_origin)

    def __len__(self) -> int:
        return len(self.points)

    def distances(self) -> NDArray[np.float32]:
        """Graph distances between all viewpoints, metres, float32, shape (n, n), inf where there is no way."""
        return _all_pairs(self.table, self.lengths)

    def distances_from(self, sources: NDArray[np.int64], seeds: NDArray[np.float64]) -> NDArray[np.float32]:
        """Graph distances from the nearest of several sources that start at given distances, metres."""
        return shortest_distances(self.table, self.lengths, sources, seeds)

    def match(self, observation: Observation, node_position: tuple[float, float]) -> NDArray[np.int64]:
        """Return the true viewpoint of each viewpoint of an observation, by position; -1 where there is none."""
        i = round((node_position[0] - self.origin[0]) / self.spacing) - self.first[0]
        j = round((node_position[1] - self.origin[1]) / self.spacing) - self.first[1]
        column = observation.offsets[:, 0].astype(np.int64) + i
        row = observation.offsets[:, 1].astype(np.int64) + j
        height, width = self.index.shape
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        found = self.index[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)].astype(np.int64)
        return np.where(inside, found, -1)


assert NEIGHBOUR_COUNT == 20
