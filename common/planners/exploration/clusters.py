"""Clusters of frontier cells."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.system.jit import njit

OPENING_LENGTH: Final = 1.5
"""Metres of frontier, counted in cells, from which a cluster is an opening."""


@njit(cache=True, nogil=True, inline="always")
def _root(parent: NDArray[np.int64], f: int) -> int:
    """Return the first cell of a cluster as it is joined so far, and shorten the way to it."""
    while parent[f] != f:
        parent[f] = parent[parent[f]]
        f = parent[f]
    return f


@njit(cache=True, nogil=True, inline="always")
def _join(parent: NDArray[np.int64], a: int, b: int) -> None:
    first, second = _root(parent, a), _root(parent, b)
    parent[max(first, second)] = min(first, second)


@njit(cache=True, nogil=True)
def cluster_labels(cells: NDArray[np.int64], width: int) -> NDArray[np.int64]:
    """Return the number of the cluster of each cell of a grid, counted from 0 on.

    Cells of a cluster are connected through their eight neighbours; clusters are numbered by their first cells.

    Args:
        cells: flat numbers, ascending, none of them in the first or last column, int64, shape (m,), see
            `Mapper.frontier_cells`.
        width: cells in a row of the grid.

    Returns:
        int64, shape (m,).
    """
    count = len(cells)
    parent = np.arange(count)
    # The first cell that may touch one of the row above it; it only moves forward.
    below = 0
    for f in range(count):
        if f and cells[f - 1] == cells[f] - 1:
            _join(parent, f - 1, f)
        while cells[below] < cells[f] - width - 1:
            below += 1
        k = below
        while cells[k] <= cells[f] - width + 1:
            _join(parent, k, f)
            k += 1
    labels = np.empty(count, dtype=np.int64)
    number = np.full(count, -1, dtype=np.int64)
    clusters = 0
    for f in range(count):
        root = _root(parent, f)
        if number[root] < 0:
            number[root] = clusters
            clusters += 1
        labels[f] = number[root]
    return labels


def openings(sizes: NDArray[np.int64], resolution: float, area: float) -> float:
    """Return how many openings into the unknown there are on 100 m2 of known floor.

    An opening is a cluster of frontier cells of `OPENING_LENGTH` or more. Offices and tunnels have 0.5 to 3, the aisles
    of a warehouse 3 to 10.

    Args:
        sizes: of the clusters, in cells, shape (n,).
        resolution: metres per cell.
        area: known floor, square metres, above 0.
    """
    return 100.0 * int(np.count_nonzero(sizes * resolution >= OPENING_LENGTH)) / area
