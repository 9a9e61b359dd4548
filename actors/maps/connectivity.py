"""Connected regions of free cells, by flood filling."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True)
def _flood(mask: NDArray[np.bool_], labels: NDArray[np.int32], stack: NDArray[np.int64], first: int, label: int) -> int:
    """Give ``label`` to the region of cell ``first`` and return its size; ``labels`` must be 0 there."""
    columns = mask.shape[1]
    rows = mask.shape[0]
    labels[first // columns, first % columns] = label
    stack[0] = first
    top = 1
    size = 0
    while top > 0:
        top -= 1
        cell = stack[top]
        size += 1
        row = cell // columns
        column = cell % columns
        if row > 0 and mask[row - 1, column] and labels[row - 1, column] == 0:
            labels[row - 1, column] = label
            stack[top] = cell - columns
            top += 1
        if row + 1 < rows and mask[row + 1, column] and labels[row + 1, column] == 0:
            labels[row + 1, column] = label
            stack[top] = cell + columns
            top += 1
        if column > 0 and mask[row, column - 1] and labels[row, column - 1] == 0:
            labels[row, column - 1] = label
            stack[top] = cell - 1
            top += 1
        if column + 1 < columns and mask[row, column + 1] and labels[row, column + 1] == 0:
            labels[row, column + 1] = label
            stack[top] = cell + 1
            top += 1
    return size


@njit(cache=True, nogil=True)
def _label(mask: NDArray[np.bool_], labels: NDArray[np.int32]) -> int:
    stack = np.empty(mask.size, dtype=np.int64)
    columns = mask.shape[1]
    count = 0
    for cell in range(mask.size):
        if mask[cell // columns, cell % columns] and labels[cell // columns, cell % columns] == 0:
            count += 1
            _flood(mask, labels, stack, cell, count)
    return count


def label_regions(mask: NDArray[np.bool_]) -> tuple[NDArray[np.int32], int]:
    """Number the 4-connected regions of a mask.

    Args:
        mask: bool, shape (rows, columns).

    Returns:
        Labels, int32, shape of ``mask``: 0 outside the mask, 1 to count inside, in row-major order of each region's
        first cell; and the count.
    """
    labels = np.zeros(mask.shape, dtype=np.int32)
    return labels, int(_label(np.ascontiguousarray(mask), labels))


def reachable(mask: NDArray[np.bool_], cell: tuple[int, int]) -> NDArray[np.bool_]:
    """Return the 4-connected region of a mask that holds a cell.

    Args:
        mask: bool, shape (rows, columns).
        cell: (row, column) inside the mask's grid.

    Returns:
        bool, shape of ``mask``; all False when the cell itself is False.
    """
    labels = np.zeros(mask.shape, dtype=np.int32)
    if mask[cell]:
        stack = np.empty(mask.size, dtype=np.int64)
        _flood(np.ascontiguousarray(mask), labels, stack, cell[0] * mask.shape[1] + cell[1], 1)
    return labels == 1
