"""Connected regions of free cells, by flood filling."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

# The four neighbours that share a side, then the four that share a corner: (row, column) steps.
_STEPS = np.array(
    [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (-1, 1), (1, -1), (1, 1)],
    dtype=np.int64,
)


@njit(cache=True, nogil=True)
def _flood(
    mask: NDArray[np.bool_],
    labels: NDArray[np.int32],
    stack: NDArray[np.int64],
    first: int,
    label: int,
    steps: NDArray[np.int64],
) -> int:
    """Give ``label`` to the region of cell ``first`` and return its size; ``labels`` must be 0 there."""
    rows, columns = mask.shape
    labels[first // columns, first % columns] = label
    stack[0] = first
    top = 1
    size = 0
    while top > 0:
        top -= 1
        cell = stack[top]
        size += 1
        row, column = cell // columns, cell % columns
        for k in range(len(steps)):
            y, x = row + steps[k, 0], column + steps[k, 1]
            if 0 <= y < rows and 0 <= x < columns and mask[y, x] and labels[y, x] == 0:
                labels[y, x] = label
                stack[top] = y * columns + x
                top += 1
    return size


@njit(cache=True, nogil=True)
def _label(mask: NDArray[np.bool_], labels: NDArray[np.int32], steps: NDArray[np.int64]) -> int:
    stack = np.empty(mask.size, dtype=np.int64)
    rows, columns = mask.shape
    count = 0
    for row in range(rows):
        for column in range(columns):
            if mask[row, column] and labels[row, column] == 0:
                count += 1
                _flood(mask, labels, stack, row * columns + column, count, steps)
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
    return labels, int(_label(np.ascontiguousarray(mask), labels, _STEPS if diagonal else _STEPS[:4]))


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
        _flood(np.ascontiguousarray(mask), labels, stack, cell[0] * mask.shape[1] + cell[1], 1, _STEPS[:4])
    return labels == 1
