"""Rims: unknown cells so near to an obstacle that the robot can never be there, whatever they hold.

The shadow between a cupboard and the wall, cells of a wall that no beam happened to meet: a robot that goes to look
into every one of them drives far, and learns nothing about where it can go.
"""

from __future__ import annotations

from math import ceil

import numpy as np
from numpy.typing import NDArray

from common.mapping.sight import OCCUPIED, UNKNOWN, Box
from common.system.jit import njit


def rim_offsets(resolution: float, radius: float) -> NDArray[np.int64]:
    """Return the offsets (rows, columns) of cells around an occupied one in which the robot's centre cannot be.

    Those are the cells whose centre is nearer to the occupied one than the radius by half a cell: none of their points
    leaves the robot the room that it needs.

    Args:
        resolution: metres per cell.
        radius: of the robot, metres.

    Returns:
        int64, shape (n, 2); the occupied cell itself is not among them.
    """
    reach = ceil(radius / resolution) + 1
    steps = np.arange(-reach, reach + 1)
    gap = np.maximum(np.abs(steps) - 0.5, 0.0) * resolution
    near = np.hypot(gap[:, None], gap[None, :]) < radius - resolution / 2 - 1e-9
    near[reach, reach] = False
    return np.argwhere(near) - reach


@njit(cache=True, nogil=True)
def close_rims(
    states: NDArray[np.int8], offsets: NDArray[np.int64], reach: int, box: Box, out: NDArray[np.int8]
) -> None:
    """Mark unknown cells of a box that are near occupied ones as occupied.

    Args:
        states: -1, 0 or 100, int8, shape (rows, columns).
        offsets: of `rim_offsets`.
        reach: the largest of them.
        box: first row, last row, first column, last column, inside the grid.
        out: cells of the box, int8, changed in place; those known there stay as they are.
    """
    rows, columns = states.shape
    top, bottom, left, right = box
    for row in range(max(top - reach, 0), min(bottom + reach, rows - 1) + 1):
        for column in range(max(left - reach, 0), min(right + reach, columns - 1) + 1):
            if states[row, column] != OCCUPIED:
                continue
            for k in range(len(offsets)):
                i, j = row + offsets[k, 0] - top, column + offsets[k, 1] - left
                if 0 <= i < out.shape[0] and 0 <= j < out.shape[1] and out[i, j] == UNKNOWN:
                    out[i, j] = OCCUPIED
