"""Shortest paths to a goal over a graph of places, in whole numbers: costs, heuristics and a fresh A* search.

Lengths are whole numbers of subcells and rounded *up*, edges and straight distances alike. Rounded up, straight
distances still obey the triangle inequality, so that a search is exact: no two sums that should be equal differ, and an
incremental search can be compared with a fresh one by ``==``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.system.copies import copy_values
from common.system.heap import pop, push
from common.system.jit import njit

# No way: above any path, and so far below the end of 64 bits that sums of a few do not overflow.
NO_WAY: Final = 1 << 60


@njit(cache=True, nogil=True, inline="always")
def straight_length(dx: int, dy: int) -> int:
    """Return the length of a straight line, rounded up exactly, whatever the rounding of the square root."""
    square = dx * dx + dy * dy
    length = int(np.sqrt(np.float64(square)))
    while length * length < square:
        length += 1
    while length > 0 and (length - 1) * (length - 1) >= square:
        length -= 1
    return length


@dataclass(frozen=True, slots=True, eq=False)
class GoalGraph:
    """Places, ways between them, and last legs to a goal that is no place itself.

    A place is known by where it is: vertex numbers hold for one graph alone.

    Attributes:
        x: of the places, subcells from a point that never moves, int64, shape (n,).
        y: likewise; places ascend by y, then by x, and no two are equal.
        pointer: first entry of each vertex, then their number, int64, shape (n + 1,).
        neighbours: vertices, ascending for each one, int32, shape (entries,); symmetric.
        costs: lengths of the edges, at least the straight ones rounded up, int64, same shape.
        goal_costs: lengths of the last legs from the vertices to the goal, `NO_WAY` without one, int64, shape (n,).
        heuristic: lower bound of the way from each vertex to the goal, int64, shape (n,).
    """

    x: NDArray[np.int64]
    y: NDArray[np.int64]
    pointer: NDArray[np.int64]
    neighbours: NDArray[np.int32]
    costs: NDArray[np.int64]
    goal_costs: NDArray[np.int64]
    heuristic: NDArray[np.int64]


@njit(cache=True, nogil=True)
def find_place(x: NDArray[np.int64], y: NDArray[np.int64], at_x: int, at_y: int) -> int:
    """Return the number of a place among those of a `GoalGraph`, -1 when it is none of them."""
    low, high = 0, len(x)
    while low < high:
        middle = (low + high) >> 1
        if y[middle] < at_y or (y[middle] == at_y and x[middle] < at_x):
            low = middle + 1
        else:
            high = middle
    return low if low < len(x) and x[low] == at_x and y[low] == at_y else -1


@njit(cache=True, nogil=True)
def _a_star(
    pointer: NDArray[np.int64],
    neighbours: NDArray[np.int32],
    costs: NDArray[np.int64],
    goal_costs: NDArray[np.int64],
    heuristic: NDArray[np.int64],
    start: int,
) -> tuple[int, int, NDArray[np.int32], int]:
    n = len(pointer) - 1
    best = np.full(n, NO_WAY)
    before = np.full(n, -1, dtype=np.int32)
    room = n + 1
    keys = np.empty(room, dtype=np.int64)
    nodes = np.empty(room, dtype=np.int32)
    best[start] = 0
    size = push(keys, nodes, 0, heuristic[start], start)
    expanded = 0
    total, last = NO_WAY, -1
    while size and keys[0] < total:
        key, node = keys[0], nodes[0]
        size = pop(keys, nodes, size)
        length = best[node]
        if key > length + heuristic[node]:
            continue
        expanded += 1
        if length + goal_costs[node] < total:
            total, last = length + goal_costs[node], node
        for k in range(pointer[node], pointer[node + 1]):
            there = neighbours[k]
            further = length + costs[k]
            if further >= best[there]:
                continue
            best[there] = further
            before[there] = node
            if size == room:
                room *= 2
                more_keys = np.empty(room, dtype=np.int64)
                more_nodes = np.empty(room, dtype=np.int32)
                copy_values(more_keys, keys)
                copy_values(more_nodes, nodes)
                keys, nodes = more_keys, more_nodes
            size = push(keys, nodes, size, further + heuristic[there], there)
    return total, last, before, expanded


def a_star(graph: GoalGraph, start: int) -> tuple[int, list[int], int]:
    """Search a shortest path from a vertex to the goal (Hart, Nilsson and Raphael, 1968).

    Nodes are expanded again when a shorter path to them turns up, so the heuristic need not be consistent.

    Returns:
        Length in subcells, `NO_WAY` without a way; the vertices of the path, the start first and the one before the
        goal last, empty without a way; and the number of expanded vertices.
    """
    total, last, before, expanded = _a_star(
        graph.pointer, graph.neighbours, graph.costs, graph.goal_costs, graph.heuristic, start
    )
    path = []
    while last >= 0:
        path.append(int(last))
        last = before[last]
    return int(total), path[::-1], int(expanded)
