"""Clusters of frontier cells."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.mapping.belief import Belief
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
def _label(rows: NDArray[np.int64], columns: NDArray[np.int64], order: NDArray[np.int64]) -> NDArray[np.int64]:
    """Join each cell with those before it in the row-major order that it touches, then number the clusters."""
    count = len(order)
    parent = np.arange(count)
    # The first cell that may touch one of the row above it; it only moves forward.
    below = 0
    for f in range(count):
        row, column = rows[order[f]], columns[order[f]]
        if f and rows[order[f - 1]] == row and columns[order[f - 1]] >= column - 1:
            _join(parent, f - 1, f)
        while rows[order[below]] < row - 1 or (rows[order[below]] == row - 1 and columns[order[below]] < column - 1):
            below += 1
        k = below
        while rows[order[k]] == row - 1 and columns[order[k]] <= column + 1:
            _join(parent, k, f)
            k += 1
    place = np.empty(count, dtype=np.int64)
    place[order] = np.arange(count)
    labels = np.empty(count, dtype=np.int64)
    number = np.full(count, -1, dtype=np.int64)
    clusters = 0
    for cell in range(count):
        root = _root(parent, place[cell])
        if number[root] < 0:
            number[root] = clusters
            clusters += 1
        labels[cell] = number[root]
    return labels


def cluster_labels(belief: Belief, frontiers: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the number of the cluster of each frontier cell, counted from 0 on.

    Cells of a cluster are connected through their eight neighbours; clusters are numbered by their first cells.

    Args:
        belief: whose frontiers these are.
        frontiers: centres of cells, metres, shape (m, 2), see `Mapper.frontiers`.

    Returns:
        int64, shape (m,).
    """
    cells = np.floor((frontiers - np.array(belief.origin)) / belief.resolution).astype(np.int64)
    columns, rows = np.ascontiguousarray(cells.T)
    # Those of a mapper are in this order already, which a stable sort finds out fast.
    order = np.argsort(rows * belief.shape[1] + columns, kind="stable")
    labels: NDArray[np.int64] = _label(rows, columns, order)
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
