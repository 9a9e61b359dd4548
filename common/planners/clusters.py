"""Clusters of frontier cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.jit import njit
from common.mapping.belief import Belief


@njit(cache=True, nogil=True)
def _label(cells: NDArray[np.int64], numbers: NDArray[np.int32]) -> NDArray[np.int64]:
    """Flood each cluster over eight neighbours; `numbers` is a grid of -1 with one cell of margin on each side."""
    count = len(cells)
    labels = np.full(count, -1, dtype=np.int64)
    stack = np.empty(count, dtype=np.int64)
    for f in range(count):
        numbers[cells[f, 1] + 1, cells[f, 0] + 1] = f
    clusters = 0
    for f in range(count):
        if labels[f] >= 0:
            continue
        labels[f] = clusters
        stack[0] = f
        size = 1
        while size:
            size -= 1
            column, row = cells[stack[size]]
            for j in range(row, row + 3):
                for i in range(column, column + 3):
                    there = numbers[j, i]
                    if there >= 0 and labels[there] < 0:
                        labels[there] = clusters
                        stack[size] = there
                        size += 1
        clusters += 1
    return labels


def cluster_labels(belief: Belief, frontiers: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the number of the cluster of each frontier cell, counted from 0 on.

    Cells of a cluster are connected through their eight neighbours.

    Args:
        belief: whose frontiers these are.
        frontiers: centres of cells, metres, shape (m, 2), see `Mapper.frontiers`.

    Returns:
        int64, shape (m,).
    """
    cells = np.floor((frontiers - np.array(belief.origin)) / belief.resolution).astype(np.int64)
    rows, columns = belief.shape
    return _label(cells, np.full((rows + 2, columns + 2), -1, dtype=np.int32))
