"""Beacons: few viewpoints that stand for all useful ones (Algorithm 1 of the paper)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.mapping.sight import CLEAR, blocker
from common.system.jit import njit


@njit(cache=True, nogil=True)
def find_beacons(
    cells: NDArray[np.int8],
    width: int,
    x: NDArray[np.int64],
    y: NDArray[np.int64],
    useful: NDArray[np.bool_],
    reach: int,
) -> NDArray[np.bool_]:
    """Choose the beacons among the reachable viewpoints (Algorithm 1).

    The useful viewpoints (those of non-zero utility) are walked in node order; each that is not covered yet becomes
    a beacon and covers all useful ones within `reach` (d_th) in line of sight.

    Args:
        cells: padded grid, flat, int8.
        width: its cells per row.
        x: of the viewpoints in node order, subcells, int64, shape (n,).
        y: likewise, ascending.
        useful: viewpoints of non-zero utility, bool, shape (n,).
        reach: d_th, subcells.

    Returns:
        Beacon flags, bool, shape (n,).
    """
    n = len(x)
    beacon = np.zeros(n, dtype=np.bool_)
    open_nodes = np.flatnonzero(useful)
    left = len(open_nodes)
    while left:
        # The first one left is not covered by any beacon before it.
        first = open_nodes[0]
        beacon[first] = True
        kept = 0
        for k in range(1, left):
            node = open_nodes[k]
            dx, dy = x[node] - x[first], y[node] - y[first]
            if (
                dx * dx + dy * dy > reach * reach
                or blocker(cells, width, x[first], y[first], x[node], y[node]) != CLEAR
            ):
                open_nodes[kept] = node
                kept += 1
        left = kept
    return beacon


@njit(cache=True, nogil=True)
def nearest_in_line(
    cells: NDArray[np.int8],
    width: int,
    x: NDArray[np.int64],
    y: NDArray[np.int64],
    target_x: int,
    target_y: int,
    reach: int,
    most: int,
) -> NDArray[np.int64]:
    """Return the nearest viewpoints from which a straight line leads to a target through open cells, ascending.

    Args:
        cells: padded grid, flat, int8, 0 where it is open.
        width: its cells per row.
        x: of the viewpoints in node order, subcells, int64, shape (n,).
        y: likewise.
        target_x: subcells.
        target_y: subcells.
        reach: farthest distance, subcells.
        most: how many at most; of equally far ones those with the lower numbers.
    """
    # The nearest so far, nearest first. Sorting by numpy's functions would take five seconds to compile.
    nodes = np.empty(most + 1, dtype=np.int64)
    distances = np.empty(most + 1, dtype=np.int64)
    found = 0
    for node in range(len(x)):
        dx, dy = x[node] - target_x, y[node] - target_y
        distance = dx * dx + dy * dy
        if distance > reach * reach or (found == most and distance >= distances[found - 1]):
            continue
        if blocker(cells, width, target_x, target_y, x[node], y[node]) != CLEAR:
            continue
        place = found
        while place > 0 and distances[place - 1] > distance:
            nodes[place], distances[place] = nodes[place - 1], distances[place - 1]
            place -= 1
        nodes[place], distances[place] = node, distance
        found = min(found + 1, most)
    taken = np.zeros(len(x), dtype=np.bool_)
    for k in range(found):
        taken[nodes[k]] = True
    ascending = np.empty(found, dtype=np.int64)
    size = 0
    for node in range(len(x)):
        if taken[node]:
            ascending[size] = node
            size += 1
    return ascending
