"""Passages: where a robot could drive from known into unknown space, given the known walls.

Lidar leaves single cells of walls unknown between two beams, and slivers behind posts and furniture. A robot with a
radius cannot go there, and what lies behind is seen through other openings or never matters.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.mapping.sight import FREE, Box
from common.system.jit import njit


@njit(cache=True, nogil=True)
def count_wall(crowd: NDArray[np.int32], row: int, column: int, spans: NDArray[np.int16], sign: int) -> None:
    """Count a wall that came (1) or went (-1), in all cells whose middle is nearer to it than the robot's radius.

    Args:
        crowd: known walls near each cell of the padded grid, int32, shape (height, width); brought up to date.
        row: of the wall's cell.
        column: of the wall's cell.
        spans: the robot's disc, see `near_spans`.
        sign: what to add.
    """
    height, width = crowd.shape
    reach = len(spans) // 2
    for r in range(max(row - reach, 0), min(row + reach, height - 1) + 1):
        span = spans[r - row + reach]
        for c in range(max(column - span, 0), min(column + span, width - 1) + 1):
            crowd[r, c] += sign


@njit(cache=True, nogil=True)
def update_passages(
    cells: NDArray[np.int8], passages: NDArray[np.bool_], crowd: NDArray[np.int32], reach: int, changed: Box
) -> Box:
    """Bring up to date from which free cells the robot could drive on into an unknown one beside it.

    In the middle of both cells it must fit by the known walls; unknown cells do not matter to that.

    Args:
        cells: padded grid of the belief, int8, shape (height, width).
        passages: such free cells, bool, same shape; brought up to date.
        crowd: walls that are too near to the middle of each cell, see `count_wall`, same shape.
        reach: rows and columns up to which a wall can be too near, cells.
        changed: box of cells that changed.

    Returns:
        The box of cells that were looked at.
    """
    height, width = cells.shape
    top, bottom = max(changed[0] - reach - 1, 1), min(changed[1] + reach + 1, height - 2)
    left, right = max(changed[2] - reach - 1, 1), min(changed[3] + reach + 1, width - 2)
    for row in range(top, bottom + 1):
        below, here, above = cells[row - 1], cells[row], cells[row + 1]
        for column in range(left, right + 1):
            passages[row, column] = False
            # Hardly any cell lies at the edge of what is known: the sign of the least one tells.
            if here[column] != FREE or min(below[column], here[column - 1], here[column + 1], above[column]) >= 0:
                continue
            if crowd[row, column]:
                continue
            for r, c in ((row - 1, column), (row, column - 1), (row, column + 1), (row + 1, column)):
                if cells[r, c] < 0 and crowd[r, c] == 0:
                    passages[row, column] = True
                    break
    return top, bottom, left, right


@njit(cache=True, nogil=True)
def any_near(passages: NDArray[np.bool_], row: int, column: int, spans: NDArray[np.int16]) -> bool:
    """Whether a passage is nearer to a cell than the robot's radius."""
    height, width = passages.shape
    reach = len(spans) // 2
    for r in range(max(row - reach, 0), min(row + reach, height - 1) + 1):
        span = spans[r - row + reach]
        for c in range(max(column - span, 0), min(column + span, width - 1) + 1):
            if passages[r, c]:
                return True
    return False
