"""D* Lite: a shortest path that is repaired, not searched anew, when edges change or the robot moves."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.jit import njit
from common.observation import NEIGHBOUR_COUNT, NEIGHBOUR_OFFSETS
from common.planners.grid_search import EDGE_UNITS, NO_WAY, straight_lengths

# Places in the array of scalars that the kernels share: entries of the queue, key modifier, expansions so far.
_SIZE: Final = 0
_MODIFIER: Final = 1
_EXPANDED: Final = 2


@njit(cache=True, nogil=True)
def _less(a: NDArray[np.int64], b: NDArray[np.int64]) -> bool:
    return a[0] < b[0] or (a[0] == b[0] and a[1] < b[1])


@njit(cache=True, nogil=True)
def _put(keys: NDArray[np.int64], nodes: NDArray[np.int32], where: NDArray[np.int32], place: int, from_: int) -> None:
    keys[place, 0], keys[place, 1] = keys[from_, 0], keys[from_, 1]
    nodes[place] = nodes[from_]
    where[nodes[place]] = place


@njit(cache=True, nogil=True)
def _settle(
    keys: NDArray[np.int64],
    nodes: NDArray[np.int32],
    where: NDArray[np.int32],
    size: int,
    place: int,
    key: NDArray[np.int64],
    node: int,
) -> None:
    """Put an entry into the heap of `size` entries whose place `place` is void."""
    while place and _less(key, keys[(place - 1) >> 1]):
        _put(keys, nodes, where, place, (place - 1) >> 1)
        place = (place - 1) >> 1
    while True:
        child = 2 * place + 1
        if child >= size:
            break
        if child + 1 < size and _less(keys[child + 1], keys[child]):
            child += 1
        if not _less(keys[child], key):
            break
        _put(keys, nodes, where, place, child)
        place = child
    keys[place, 0], keys[place, 1] = key[0], key[1]
    nodes[place] = node
    where[node] = place


@njit(cache=True, nogil=True)
def _remove(
    keys: NDArray[np.int64], nodes: NDArray[np.int32], where: NDArray[np.int32], scalars: NDArray[np.int64], node: int
) -> None:
    place = where[node]
    where[node] = -1
    scalars[_SIZE] -= 1
    last = scalars[_SIZE]
    if place != last:
        key = np.array([keys[last, 0], keys[last, 1]])
        _settle(keys, nodes, where, last, place, key, nodes[last])


@njit(cache=True, nogil=True)
def _key(
    key: NDArray[np.int64], cost: NDArray[np.int64], modifier: int, straight: NDArray[np.int64], start: int, node: int
) -> None:
    """CalculateKey(s): fill in ``[min(g, rhs) + h(s_start, s) + k_m, min(g, rhs)]``."""
    columns = straight.shape[1]
    smaller = min(cost[node, 0], cost[node, 1])
    h = straight[abs(node // columns - start // columns), abs(node % columns - start % columns)]
    key[0] = min(smaller + h + modifier, NO_WAY)
    key[1] = smaller


@njit(cache=True, nogil=True)
def _update_vertex(
    key: NDArray[np.int64],
    cost: NDArray[np.int64],
    keys: NDArray[np.int64],
    nodes: NDArray[np.int32],
    where: NDArray[np.int32],
    scalars: NDArray[np.int64],
    straight: NDArray[np.int64],
    start: int,
    node: int,
) -> None:
    """UpdateVertex(u): an inconsistent vertex belongs into the queue with its key of today, no other does."""
    if cost[node, 0] == cost[node, 1]:
        if where[node] >= 0:
            _remove(keys, nodes, where, scalars, node)
        return
    _key(key, cost, scalars[_MODIFIER], straight, start, node)
    place = where[node]
    if place < 0:
        place = scalars[_SIZE]
        scalars[_SIZE] += 1
    _settle(keys, nodes, where, scalars[_SIZE], place, key, node)


@njit(cache=True, nogil=True)
def _best_successor(
    edges: NDArray[np.uint32],
    goal_units: NDArray[np.int64],
    offsets: NDArray[np.int16],
    costs: NDArray[np.int64],
    cost: NDArray[np.int64],
    node: int,
) -> tuple[int, int]:
    """Return min over successors s' of c(s, s') + g(s'), and the successor, -1 for the goal itself."""
    columns = edges.shape[1]
    best, successor, edge = goal_units[node], -1, 0
    mask = edges[node // columns, node % columns]
    for k in range(NEIGHBOUR_COUNT):
        if (mask >> np.uint32(k)) & np.uint32(1):
            there = node + offsets[k, 1] * columns + offsets[k, 0]
            total = costs[k] + cost[there, 0]
            # Of equally good ways the robot sees more on the one with the shorter edge.
            if total < best or (total == best and successor >= 0 and costs[k] < edge):
                best, successor, edge = total, there, costs[k]
    return min(best, NO_WAY), successor


@njit(cache=True, nogil=True)
def _search(
    edges: NDArray[np.uint32],
    goal_units: NDArray[np.int64],
    offsets: NDArray[np.int16],
    costs: NDArray[np.int64],
    straight: NDArray[np.int64],
    cost: NDArray[np.int64],
    keys: NDArray[np.int64],
    nodes: NDArray[np.int32],
    where: NDArray[np.int32],
    scalars: NDArray[np.int64],
    start: int,
) -> None:
    """ComputeShortestPath()."""
    columns = edges.shape[1]
    key = np.empty(2, dtype=np.int64)
    start_key = np.empty(2, dtype=np.int64)
    while scalars[_SIZE]:
        _key(start_key, cost, scalars[_MODIFIER], straight, start, start)
        if not (_less(keys[0], start_key) or cost[start, 1] > cost[start, 0]):
            break
        u = nodes[0]
        _key(key, cost, scalars[_MODIFIER], straight, start, u)
        if _less(keys[0], key):
            _settle(keys, nodes, where, scalars[_SIZE], 0, key, u)
            continue
        scalars[_EXPANDED] += 1
        old = cost[u, 0]
        lowered = old > cost[u, 1]
        if lowered:
            cost[u, 0] = cost[u, 1]
            _remove(keys, nodes, where, scalars, u)
        else:
            cost[u, 0] = NO_WAY
            _update_vertex(key, cost, keys, nodes, where, scalars, straight, start, u)
        mask = edges[u // columns, u % columns]
        for k in range(NEIGHBOUR_COUNT):
            if not (mask >> np.uint32(k)) & np.uint32(1):
                continue
            s = u + offsets[k, 1] * columns + offsets[k, 0]
            if lowered:
                if costs[k] + cost[u, 0] >= cost[s, 1]:
                    continue
                cost[s, 1] = costs[k] + cost[u, 0]
            elif cost[s, 1] == costs[k] + old:
                cost[s, 1] = _best_successor(edges, goal_units, offsets, costs, cost, s)[0]
            else:
                continue
            _update_vertex(key, cost, keys, nodes, where, scalars, straight, start, s)


@njit(cache=True, nogil=True)
def _change(
    edges: NDArray[np.uint32],
    goal_units: NDArray[np.int64],
    offsets: NDArray[np.int16],
    costs: NDArray[np.int64],
    straight: NDArray[np.int64],
    cost: NDArray[np.int64],
    keys: NDArray[np.int64],
    nodes: NDArray[np.int32],
    where: NDArray[np.int32],
    scalars: NDArray[np.int64],
    start: int,
    changed: NDArray[np.int64],
) -> None:
    """Recompute rhs of the vertices whose edges changed, and queue those that became inconsistent."""
    key = np.empty(2, dtype=np.int64)
    for u in changed:
        cost[u, 1] = _best_successor(edges, goal_units, offsets, costs, cost, u)[0]
        _update_vertex(key, cost, keys, nodes, where, scalars, straight, start, u)


class IncrementalSearch:
    """D* Lite on the lattice, in its final form (Koenig and Likhachev 2002, figure 4).

    It searches from the goal to the robot and keeps g, rhs and the queue between calls, so that a change of edges costs
    no more than the vertices whose distance to the goal it touches *and* that matter for the robot's path. The queue's
    keys have two parts; when the robot moves, the key modifier k_m grows instead of every key being computed anew.

    Usage::

        search = IncrementalSearch(shape)
        units = search.replan(edges, goal_units, start)  # after any change, or any move of the robot
        path = search.path()

    The goal is no lattice point: it is tied to lattice points by its last legs, and it counts as expanded from the
    beginning.

    Attributes:
        expanded: vertices expanded since the start.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        """Start on a lattice of (rows, columns) without edges."""
        self._allocate(shape)
        self._scalars = np.zeros(3, dtype=np.int64)
        self._start = -1

    @property
    def expanded(self) -> int:
        """Vertices expanded since the start."""
        return int(self._scalars[_EXPANDED])

    def extend(self, shape: tuple[int, int], down: int, left: int) -> None:
        """Grow the lattice to `shape`: what is known goes on, `down` new rows before it and `left` new columns."""
        rows, columns = self._edges.shape
        edges, goal_units, cost, nodes = self._edges, self._goal_units, self._cost, self._nodes
        keys, size = self._keys, int(self._scalars[_SIZE])
        self._allocate(shape)
        part = np.s_[down : down + rows, left : left + columns]
        self._edges[part] = edges
        self._goal_units.reshape(shape)[part] = goal_units.reshape(rows, columns)
        self._cost.reshape(*shape, 2)[part] = cost.reshape(rows, columns, 2)
        self._keys[:size] = keys[:size]
        self._nodes[:size] = (nodes[:size] // columns + down) * shape[1] + nodes[:size] % columns + left
        self._where[self._nodes[:size]] = np.arange(size, dtype=np.int32)
        if self._start >= 0:
            self._start = (self._start // columns + down) * shape[1] + self._start % columns + left

    def replan(self, edges: NDArray[np.uint32], goal_units: NDArray[np.int64], start: int) -> int:
        """Take in the edges as they are now, and the robot's place, and return the length of a shortest path.

        Args:
            edges: 20-bit masks, uint32, shape (rows, columns), symmetric; none leaves the array.
            goal_units: length of the last leg from each lattice point, `NO_WAY` where there is none, int64, flat.
            start: the robot's lattice point, flat index.

        Returns:
            Units, `NO_WAY` when no path leads to the goal.
        """
        if self._start >= 0:
            rows, columns = np.divmod([self._start, start], self._edges.shape[1])
            self._scalars[_MODIFIER] += self._straight[abs(rows[0] - rows[1]), abs(columns[0] - columns[1])]
        self._start = start
        changed = np.flatnonzero((edges != self._edges).reshape(-1) | (goal_units != self._goal_units))
        if len(changed):
            self._edges[:] = edges
            self._goal_units[:] = goal_units
            _change(*self._state(), start, changed)
        _search(*self._state(), start)
        return int(min(self._cost[start, 1], NO_WAY))

    def path(self) -> list[int]:
        """Return the lattice points of a shortest path, the robot's first; empty when there is none."""
        node = self._start
        if node < 0 or self._cost[node, 1] >= NO_WAY:
            return []
        path = [node]
        while True:
            _, node = _best_successor(
                self._edges, self._goal_units, NEIGHBOUR_OFFSETS, EDGE_UNITS, self._cost, path[-1]
            )
            if node < 0:
                return path
            path.append(int(node))

    def _allocate(self, shape: tuple[int, int]) -> None:
        n = shape[0] * shape[1]
        self._edges = np.zeros(shape, dtype=np.uint32)
        self._goal_units = np.full(n, NO_WAY, dtype=np.int64)
        # g and rhs of each vertex.
        self._cost = np.full((n, 2), NO_WAY, dtype=np.int64)
        self._keys = np.empty((n, 2), dtype=np.int64)
        self._nodes = np.empty(n, dtype=np.int32)
        # Place of each vertex in the queue, -1 for none.
        self._where = np.full(n, -1, dtype=np.int32)
        self._straight = straight_lengths(*shape)

    def _state(self) -> tuple[NDArray[np.generic], ...]:
        return (
            self._edges,
            self._goal_units,
            NEIGHBOUR_OFFSETS,
            EDGE_UNITS,
            self._straight,
            self._cost,
            self._keys,
            self._nodes,
            self._where,
            self._scalars,
        )
