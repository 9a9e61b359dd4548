"""The cells that the robot's body covers: free, whatever the map says."""

from __future__ import annotations

from math import ceil, floor

import numpy as np
from numpy.typing import NDArray

from common.mapping.sight import FREE, Box


def clear_footprint(cells: NDArray[np.int8], box: Box, position: tuple[float, float], radius: float) -> None:
    """Mark the cells of a box whose centres the robot's body covers as free, in place, and the one it stands in.

    Args:
        cells: of the box, int8.
        box: first row, last row, first column, last column.
        position: (row, column) of the robot's centre in the grid of the box, in cells, with fractions.
        radius: of the robot, cells.
    """
    top, bottom, left, right = box
    rows = np.arange(top, bottom + 1)[:, None] + 0.5 - position[0]
    columns = np.arange(left, right + 1)[None, :] + 0.5 - position[1]
    body = np.hypot(rows, columns) <= radius
    row, column = floor(position[0]) - top, floor(position[1]) - left
    if 0 <= row < body.shape[0] and 0 <= column < body.shape[1]:
        body[row, column] = True
    cells[body] = FREE


def footprint_box(position: tuple[float, float], radius: float, shape: tuple[int, int]) -> Box:
    """Return the box of a grid's cells that the body may cover; it is empty where the robot is outside."""
    reach = ceil(radius)
    row, column = floor(position[0]), floor(position[1])
    return (
        max(row - reach, 0),
        min(row + reach, shape[0] - 1),
        max(column - reach, 0),
        min(column + reach, shape[1] - 1),
    )
