"""D* Lite: a shortest path that is repaired instead of searched again when edges change or the robot moves."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.planners.navigation.graph_change import changed_vertices, match_places
from common.planners.navigation.graph_search import NO_WAY, GoalGraph, straight_length
from common.planners.navigation.indexed_heap import less, remove, settle
from common.system.jit import njit

# Places in the array of scalars that the kernels share: entries of the queue, key modifier, expansions so far.
_SIZE: Final = 0
_MODIFIER: Final = 1
_EXPANDED: Final = 2


@njit(cache=True, nogil=True)
def _key(
    key: NDArray[np.int64],
    cost: NDArray[np.int64],
    modifier: int,
    x: NDArray[np.int64],
    y: NDArray[np.int64],
    start: int,
    node: int,
) -> None:
    """CalculateKey(s): fill in ``[min(g, rhs) + h(s_start, s) + k_m, min(g, rhs)]``."""
    smaller = min(cost[node, 0], cost[node, 1])
    key[0] = min(smaller + straight_length(x[node] - x[start], y[node] - y[start]) + modifier, NO_WAY)
    key[1] = smaller


@njit(cache=True, nogil=True)
def _update_vertex(
    key: NDArray[np.int64],
    cost: NDArray[np.int64],
    keys: NDArray[np.int64],
    nodes: NDArray[np.int32],
    where: NDArray[np.int32],
    scalars: NDArray[np.int64],
    x: NDArray[np.int64],
    y: NDArray[np.int64],
    start: int,
    node: int,
) -> None:
    """UpdateVertex(u): an inconsistent vertex belongs into the queue with its key of today, no other does."""
    if cost[node, 0] == cost[node, 1]:
        if where[node] >= 0:
            scalars[_SIZE] = remove(keys, nodes, where, scalars[_SIZE], node)
        return
    _key(key, cost, scalars[_MODIFIER], x, y, start, node)
    place = np.int64(where[node])
    if place < 0:
        place = scalars[_SIZE]
        scalars[_SIZE] += 1
    settle(keys, nodes, where, scalars[_SIZE], place, key, node)


@njit(cache=True, nogil=True)
def _best_successor(
    pointer: NDArray[np.int64],
    neighbours: NDArray[np.int32],
    costs: NDArray[np.int64],
    goal_costs: NDArray[np.int64],
    cost: NDArray[np.int64],
    node: int,
) -> tuple[int, int]:
    """Return min over successors s' of c(s, s') + g(s'), and the successor, -1 for the goal itself."""
    best, successor, edge = goal_costs[node], -1, 0
    for k in range(pointer[node], pointer[node + 1]):
        total = costs[k] + cost[neighbours[k], 0]
        # Of equally good ways the robot sees more on the one with the shorter edge.
        if total < best or (total == best and successor >= 0 and costs[k] < edge):
            best, successor, edge = total, neighbours[k], costs[k]
    return min(best, NO_WAY), successor


@njit(cache=True, nogil=True)
def _search(
    x: NDArray[np.int64],
    y: NDArray[np.int64],
    pointer: NDArray[np.int64],
    neighbours: NDArray[np.int32],
    costs: NDArray[np.int64],
    goal_costs: NDArray[np.int64],
    cost: NDArray[np.int64],
    keys: NDArray[np.int64],
    nodes: NDArray[np.int32],
    where: NDArray[np.int32],
    scalars: NDArray[np.int64],
    start: int,
) -> None:
    """ComputeShortestPath()."""
    key = np.empty(2, dtype=np.int64)
    start_key = np.empty(2, dtype=np.int64)
    while scalars[_SIZE]:
        _key(start_key, cost, scalars[_MODIFIER], x, y, start, np.int32(start))
        if not (less(keys[0], start_key) or cost[start, 1] > cost[start, 0]):
            break
        u = nodes[0]
        _key(key, cost, scalars[_MODIFIER], x, y, start, u)
        if less(keys[0], key):
            settle(keys, nodes, where, scalars[_SIZE], 0, key, u)
            continue
        scalars[_EXPANDED] += 1
        old = cost[u, 0]
        lowered = old > cost[u, 1]
        if lowered:
            cost[u, 0] = cost[u, 1]
            scalars[_SIZE] = remove(keys, nodes, where, scalars[_SIZE], u)
        else:
            cost[u, 0] = NO_WAY
            _update_vertex(key, cost, keys, nodes, where, scalars, x, y, start, u)
        for k in range(pointer[u], pointer[u + 1]):
            s = neighbours[k]
            if lowered:
                if costs[k] + cost[u, 0] >= cost[s, 1]:
                    continue
                cost[s, 1] = costs[k] + cost[u, 0]
            elif cost[s, 1] == costs[k] + old:
                cost[s, 1] = _best_successor(pointer, neighbours, costs, goal_costs, cost, s)[0]
            else:
                continue
            _update_vertex(key, cost, keys, nodes, where, scalars, x, y, start, s)


@njit(cache=True, nogil=True)
def _renumber(
    new_of: NDArray[np.int32],
    n: int,
    old_cost: NDArray[np.int64],
    old_keys: NDArray[np.int64],
    old_nodes: NDArray[np.int32],
    scalars: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int32], NDArray[np.int32]]:
    """Carry g, rhs and the queue over to the numbers of another graph; places that are no more leave the queue."""
    cost = np.full((n, 2), NO_WAY, dtype=np.int64)
    for old in range(len(new_of)):
        if new_of[old] >= 0:
            cost[new_of[old], 0], cost[new_of[old], 1] = old_cost[old, 0], old_cost[old, 1]
    keys = np.empty((n, 2), dtype=np.int64)
    nodes = np.empty(n, dtype=np.int32)
    where = np.full(n, -1, dtype=np.int32)
    size = 0
    for place in range(scalars[_SIZE]):
        node = new_of[old_nodes[place]]
        if node >= 0:
            settle(keys, nodes, where, size + 1, size, old_keys[place], node)
            size += 1
    scalars[_SIZE] = size
    return cost, keys, nodes, where


@njit(cache=True, nogil=True)
def _change(
    x: NDArray[np.int64],
    y: NDArray[np.int64],
    pointer: NDArray[np.int64],
    neighbours: NDArray[np.int32],
    costs: NDArray[np.int64],
    goal_costs: NDArray[np.int64],
    cost: NDArray[np.int64],
    keys: NDArray[np.int64],
    nodes: NDArray[np.int32],
    where: NDArray[np.int32],
    scalars: NDArray[np.int64],
    start: int,
    changed: NDArray[np.bool_],
) -> None:
    """Recompute rhs of the vertices whose edges changed, and queue those that became inconsistent."""
    key = np.empty(2, dtype=np.int64)
    for vertex in range(len(changed)):
        if changed[vertex]:
            # As the queue keeps it: the kernels are compiled for one kind of integer.
            u = np.int32(vertex)
            cost[u, 1] = _best_successor(pointer, neighbours, costs, goal_costs, cost, u)[0]
            _update_vertex(key, cost, keys, nodes, where, scalars, x, y, start, u)


class IncrementalSearch:
    """D* Lite, in its final form (Koenig and Likhachev 2002, figure 4), on a graph whose places come and go.

    It searches from the goal to the robot and keeps g, rhs and the queue between calls, so that a change of edges costs
    no more than the vertices whose distance to the goal it touches *and* that matter for the robot's path. The queue's
    keys have two parts; when the robot moves, the key modifier k_m grows instead of every key being computed anew.

    Usage::

        search = IncrementalSearch()
        length = search.replan(graph, start)  # after any change, or any move of the robot
        path = search.path()

    The goal is no vertex: it is tied to vertices by its last legs, and it counts as expanded from the beginning. What
    is known of a place is kept as long as each graph holds a vertex there, whatever its number. All that was joined to
    a place that is no more has other edges than before, so nothing is left that was derived from it.
    """

    def __init__(self) -> None:
        """Start without a graph."""
        nothing = np.zeros(0, dtype=np.int64)
        no_nodes = np.zeros(0, dtype=np.int32)
        self._graph = GoalGraph(nothing, nothing, np.zeros(1, np.int64), no_nodes, nothing, nothing, nothing)
        # g and rhs of each vertex.
        self._cost = np.zeros((0, 2), dtype=np.int64)
        self._keys = np.zeros((0, 2), dtype=np.int64)
        self._nodes = no_nodes
        # Place of each vertex in the queue, -1 for none.
        self._where = no_nodes
        self._scalars = np.zeros(3, dtype=np.int64)
        self._start = -1

    @property
    def expanded(self) -> int:
        """Vertices expanded since the start."""
        return int(self._scalars[_EXPANDED])

    def replan(self, graph: GoalGraph, start: int) -> int:
        """Take in the graph as it is now, and the robot's place, and return the length of a shortest path.

        Args:
            graph: measured from the same point as all before.
            start: the robot's vertex.

        Returns:
            Subcells, `NO_WAY` when no path leads to the goal.
        """
        old = self._graph
        if self._start >= 0:
            self._scalars[_MODIFIER] += straight_length(
                int(graph.x[start] - old.x[self._start]), int(graph.y[start] - old.y[self._start])
            )
        new_of = match_places(old.x, old.y, graph.x, graph.y)
        if len(old.x) != len(graph.x) or (new_of < 0).any():
            self._cost, self._keys, self._nodes, self._where = _renumber(
                new_of, len(graph.x), self._cost, self._keys, self._nodes, self._scalars
            )
        changed = changed_vertices(
            new_of, old.pointer, old.neighbours, old.costs, old.goal_costs, graph.pointer, graph.neighbours,
            graph.costs, graph.goal_costs,
        )  # fmt: skip
        self._graph, self._start = graph, start
        _change(*self._state(), start, changed)
        _search(*self._state(), start)
        return int(min(self._cost[start, 1], NO_WAY))

    def path(self) -> list[int]:
        """Return the vertices of a shortest path, the robot's first; empty when there is none."""
        node = self._start
        if node < 0 or self._cost[node, 1] >= NO_WAY:
            return []
        graph = self._graph
        path = [node]
        while True:
            _, node = _best_successor(
                graph.pointer, graph.neighbours, graph.costs, graph.goal_costs, self._cost, path[-1]
            )
            if node < 0:
                return path
            path.append(int(node))

    def _state(self) -> tuple[NDArray[np.generic], ...]:
        graph = self._graph
        return (
            graph.x,
            graph.y,
            graph.pointer,
            graph.neighbours,
            graph.costs,
            graph.goal_costs,
            self._cost,
            self._keys,
            self._nodes,
            self._where,
            self._scalars,
        )
