"""Room for the robot's body: what the common graph may use, made from what is known."""

from __future__ import annotations

from math import ceil

import numpy as np
from numpy.typing import NDArray

from common.jit import njit
from common.mapping.sight import FREE, OCCUPIED, Box

# A robot that stands inside the room kept around walls is led out of it from this far at most, metres.
WAY_OUT = 2.0


def inflation_offsets(resolution: float, radius: float, clearance: float) -> NDArray[np.int64]:
    """Return the offsets (rows, columns) of cells around an occupied one that the robot's centre must not enter.

    Those are the cells of which any point is nearer than ``radius`` to any point of the occupied cell, and those whose
    centre is nearer than ``radius + clearance`` to any point of it.

    Returns:
        int64, shape (n, 2); the occupied cell itself is not among them.
    """
    reach = ceil((radius + clearance) / resolution) + 1
    steps = np.arange(-reach, reach + 1)
    gap = np.maximum(np.abs(steps) - 1, 0) * resolution
    centre_gap = np.maximum(np.abs(steps) - 0.5, 0.0) * resolution
    # What is as far as the limit but for rounding keeps its distance.
    near = np.hypot(gap[:, None], gap[None, :]) < radius - 1e-9
    near |= np.hypot(centre_gap[:, None], centre_gap[None, :]) < radius + clearance - 1e-9
    near[reach, reach] = False
    return np.argwhere(near) - reach


@njit(cache=True, nogil=True)
def inflate(states: NDArray[np.int8], offsets: NDArray[np.int64], reach: int, box: Box, out: NDArray[np.int8]) -> None:
    """Write the inflated cells of a box.

    Args:
        states: -1, 0 or 100, int8, shape (rows, columns).
        offsets: of `inflation_offsets`.
        reach: the largest of them.
        box: first row, last row, first column, last column, inside the grid.
        out: receives the box, int8, its shape.
    """
    rows, columns = states.shape
    top, bottom, left, right = box
    out[:] = states[top : bottom + 1, left : right + 1]
    for row in range(max(top - reach, 0), min(bottom + reach, rows - 1) + 1):
        for column in range(max(left - reach, 0), min(right + reach, columns - 1) + 1):
            if states[row, column] != OCCUPIED:
                continue
            for k in range(len(offsets)):
                i, j = row + offsets[k, 0] - top, column + offsets[k, 1] - left
                if 0 <= i < out.shape[0] and 0 <= j < out.shape[1]:
                    out[i, j] = OCCUPIED


@njit(cache=True, nogil=True)
def _way_out(states: NDArray[np.int8], inflated: NDArray[np.int8], row: int, column: int) -> float:
    """Return how far the nearest cell is that is free when inflated and can be reached past walls; negative: none.

    Args:
        states: cells of a box before they were inflated.
        inflated: the same when inflated.
        row: of the robot in the box.
        column: likewise.

    Returns:
        Straight distance in cells.
    """
    rows, columns = states.shape
    seen = np.zeros(states.shape, dtype=np.bool_)
    queue = np.empty(states.size, dtype=np.int64)
    queue[0] = row * columns + column
    seen[row, column] = True
    head, tail = 0, 1
    while head < tail:
        i, j = queue[head] // columns, queue[head] % columns
        head += 1
        if inflated[i, j] == FREE:
            return np.sqrt(float((i - row) ** 2 + (j - column) ** 2))
        for di, dj in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            k, m = i + di, j + dj
            if 0 <= k < rows and 0 <= m < columns and not seen[k, m] and states[k, m] == FREE:
                seen[k, m] = True
                queue[tail] = k * columns + m
                tail += 1
    return -1.0


def footprint(
    states: NDArray[np.int8],
    inflated: NDArray[np.int8],
    box: Box,
    position: tuple[float, float],
    radius: float,
) -> None:
    """Let the robot out of where it stands: correct the inflated cells of a box around it.

    Where the robot stands is free, whatever the map says: the cells whose centres its body covers. If its centre lies
    in the room kept around walls, that room is taken back as far as the nearest free cell and a bit more, so that a
    robot beside a wall sees a way out; walls themselves stay.

    Args:
        states: the cells before they were inflated.
        inflated: cells of the box, brought up to date.
        box: first row, last row, first column, last column; it should reach `WAY_OUT` around the robot.
        position: (row, column) of the robot's centre in ``states``, in cells, with fractions.
        radius: of the robot, cells.
    """
    top, bottom, left, right = box
    rows = np.arange(top, bottom + 1)[:, None] + 0.5 - position[0]
    columns = np.arange(left, right + 1)[None, :] + 0.5 - position[1]
    distance = np.hypot(rows, columns)
    body = distance <= radius
    here = (int(position[0]) - top, int(position[1]) - left)
    body[here] = True
    if inflated[here] != FREE:
        known = states[top : bottom + 1, left : right + 1].copy()
        known[body] = FREE
        nearest = _way_out(known, inflated, *here)
        surroundings = distance <= (nearest if nearest >= 0.0 else 2.0 * radius) + 1.5
        inflated[surroundings] = known[surroundings]
    inflated[body] = FREE
