"""Rims: unknown cells beside obstacles that no part of the robot can ever be in, whatever they hold.

The shadow between a cupboard and the wall, cells of a wall that no beam happened to meet: a robot that goes to look
into every one of them drives far, and learns nothing about where it can go. What the robot would cover on its way
through a door is no rim: closed, it would make the door look narrower than it is.
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
    """Mark unknown cells of a box as occupied that the robot covers from nowhere where its centre can be.

    Args:
        states: -1, 0 or 100, int8, shape (rows, columns); what lies around them is unknown.
        offsets: of `rim_offsets`; what is nearer to an obstacle is the robot's body as well.
        reach: the largest of them. Cells count up to twice as far from the box.
        box: first row, last row, first column, last column, inside the grid.
        out: cells of the box, int8, changed in place; those known there stay as they are.
    """
    rows, columns = states.shape
    top, bottom, left, right = box
    # Where the robot's centre cannot be, in the box and as far around it as the offsets go.
    closed = np.zeros((bottom - top + 1 + 2 * reach, right - left + 1 + 2 * reach), dtype=np.bool_)
    for row in range(max(top - 2 * reach, 0), min(bottom + 2 * reach, rows - 1) + 1):
        for column in range(max(left - 2 * reach, 0), min(right + 2 * reach, columns - 1) + 1):
            if states[row, column] != OCCUPIED:
                continue
            for k in range(len(offsets)):
                i, j = row + offsets[k, 0] - top + reach, column + offsets[k, 1] - left + reach
                if 0 <= i < closed.shape[0] and 0 <= j < closed.shape[1]:
                    closed[i, j] = True
            if top - reach <= row <= bottom + reach and left - reach <= column <= right + reach:
                closed[row - top + reach, column - left + reach] = True
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            if out[row, column] != UNKNOWN or not closed[row + reach, column + reach]:
                continue
            covered = False
            for k in range(len(offsets)):
                if not closed[row + reach + offsets[k, 0], column + reach + offsets[k, 1]]:
                    covered = True
                    break
            if not covered:
                out[row, column] = OCCUPIED
