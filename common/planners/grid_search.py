"""Shortest paths on the regular lattice of viewpoints, in whole numbers: costs, heuristics and a fresh A* search.

Lengths are counted in units of 1/65536 spacing and rounded *up*, edges and straight distances alike. Rounded up,
straight distances still obey the triangle inequality, so that a search is exact: no two sums that should be equal
differ, and an incremental search can be compared with a fresh one by ``==``.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.heap import pop, push
from common.jit import njit
from common.observation import NEIGHBOUR_COUNT, NEIGHBOUR_OFFSETS

UNITS: Final = 1 << 16
# No way: above any path, and so far below the end of 64 bits that sums of a few do not overflow.
NO_WAY: Final = 1 << 60


def straight_lengths(rows: int, columns: int) -> NDArray[np.int64]:
    """Return straight distances on the lattice by steps in y and x, units, shape (rows, columns).

    They are exact ceilings, whatever the rounding of the square root.
    """
    dy, dx = np.ogrid[:rows, :columns]
    squares = (dx.astype(np.int64) ** 2 + dy.astype(np.int64) ** 2) * UNITS**2
    lengths = np.ceil(np.sqrt(squares.astype(np.float64))).astype(np.int64)
    lengths += lengths**2 < squares
    lengths -= (lengths > 0) & ((lengths - 1) ** 2 >= squares)
    return lengths


_TABLE = straight_lengths(3, 3)
EDGE_UNITS: NDArray[np.int64] = np.array([_TABLE[abs(dy), abs(dx)] for dx, dy in NEIGHBOUR_OFFSETS.tolist()])
"""Cost of each of the 20 edges, units, int64."""


@njit(cache=True, nogil=True)
def _a_star(
    edges: NDArray[np.uint32],
    goal_units: NDArray[np.int64],
    heuristic: NDArray[np.int64],
    offsets: NDArray[np.int16],
    costs: NDArray[np.int64],
    start: int,
) -> tuple[int, int, NDArray[np.int32], int]:
    rows, columns = edges.shape
    n = rows * columns
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
        if length + goal_units[node] < total:
            total, last = length + goal_units[node], node
        mask = edges[node // columns, node % columns]
        for k in range(NEIGHBOUR_COUNT):
            if not (mask >> np.uint32(k)) & np.uint32(1):
                continue
            there = node + offsets[k, 1] * columns + offsets[k, 0]
            further = length + costs[k]
            if further >= best[there]:
                continue
            best[there] = further
            before[there] = node
            if size == room:
                room *= 2
                more_keys = np.empty(room, dtype=np.int64)
                more_nodes = np.empty(room, dtype=np.int32)
                more_keys[:size] = keys
                more_nodes[:size] = nodes
                keys, nodes = more_keys, more_nodes
            size = push(keys, nodes, size, further + heuristic[there], there)
    return total, last, before, expanded


def a_star(
    edges: NDArray[np.uint32],
    goal_units: NDArray[np.int64],
    heuristic: NDArray[np.int64],
    start: int,
) -> tuple[int, list[int], int]:
    """Search a shortest path from a lattice point to the goal (Hart, Nilsson and Raphael, 1968).

    Nodes are expanded again when a shorter path to them turns up, so the heuristic need not be consistent.

    Args:
        edges: 20-bit masks over `NEIGHBOUR_OFFSETS`, uint32, shape (rows, columns), symmetric, none leaves the array.
        goal_units: length of the last leg from each lattice point to the goal, `NO_WAY` where there is none, int64,
            shape (rows * columns,).
        heuristic: lower bound of the way from each lattice point to the goal, units, int64, shape (rows * columns,).
        start: flat lattice index.

    Returns:
        Length in units, `NO_WAY` without a way; the lattice points of the path, the start first and the one before
        the goal last, empty without a way; and the number of expanded nodes.
    """
    total, last, before, expanded = _a_star(edges, goal_units, heuristic, NEIGHBOUR_OFFSETS, EDGE_UNITS, start)
    path = []
    while last >= 0:
        path.append(int(last))
        last = before[last]
    return int(total), path[::-1], int(expanded)
