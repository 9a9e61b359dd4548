"""Connected regions of cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.system.jit import njit


@njit(cache=True, nogil=True)
def _root(parent: NDArray[np.int32], label: int) -> int:
    while parent[label] != label:
        parent[label] = parent[parent[label]]
        label = parent[label]
    return label


@njit(cache=True, nogil=True)
def _label(mask: NDArray[np.bool_], labels: NDArray[np.int32], diagonal: bool) -> int:
    """Label in two passes with a union-find over provisional labels; return the number of regions."""
    rows, columns = mask.shape
    parent = np.zeros(mask.size // 2 + 2, dtype=np.int32)
    made = 0
    for row in range(rows):
        for column in range(columns):
            if not mask[row, column]:
                continue
            label = 0
            if column > 0:
                label = labels[row, column - 1]
            if row > 0:
                # With corners, the three cells below; without, only the middle one.
                for beside in range(-1, 2):
                    if (beside != 0 and not diagonal) or not 0 <= column + beside < columns:
                        continue
                    other = labels[row - 1, column + beside]
                    if other in (0, label):
                        continue
                    if label == 0:
                        label = other
                    else:
                        a, b = _root(parent, label), _root(parent, other)
                        parent[max(a, b)] = min(a, b)
            if label == 0:
                made += 1
                parent[made] = made
                label = made
            labels[row, column] = label
    # A root is the smallest label of its region, so counting roots upwards keeps the order of first cells.
    count = 0
    final = np.zeros(made + 1, dtype=np.int32)
    for label in range(1, made + 1):
        root = _root(parent, label)
        if root == label:
            count += 1
            final[label] = count
        else:
            final[label] = final[root]
    for row in range(rows):
        for column in range(columns):
            labels[row, column] = final[labels[row, column]]
    return count


def label_regions(mask: NDArray[np.bool_], *, diagonal: bool = False) -> tuple[NDArray[np.int32], int]:
    """Number the connected regions of a mask.

    Args:
        mask: bool, shape (rows, columns).
        diagonal: whether cells that share only a corner are connected too.

    Returns:
        Labels, int32, shape of ``mask``: 0 outside the mask, 1 to count inside, in row-major order of each region's
        first cell; and the count.
    """
    labels = np.zeros(mask.shape, dtype=np.int32)
    return labels, int(_label(np.ascontiguousarray(mask), labels, diagonal))


def reachable(mask: NDArray[np.bool_], cell: tuple[int, int]) -> NDArray[np.bool_]:
    """Return the 4-connected region of a mask that holds a cell.

    Args:
        mask: bool, shape (rows, columns).
        cell: (row, column) inside the mask's grid.

    Returns:
        bool, shape of ``mask``; all False when the cell itself is False.
    """
    labels, _ = label_regions(mask)
    return np.logical_and(labels == labels[cell], mask)
