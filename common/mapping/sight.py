"""Lines of sight through known free cells, in exact integer geometry.

The belief is passed as its padded grid: one ring of `OUTSIDE` cells around the cells, so that no kernel needs a bounds
check. Points are in subcells (see `common.mapping.raycast`) from the lower left corner of the *padded* grid.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.mapping.raycast import SUBCELL_BITS, SUBCELLS
from common.system.jit import njit

FREE: Final = 0
OCCUPIED: Final = 100
UNKNOWN: Final = -1
# The ring around the grid: unknown, too, and a sign to `Belief.integrate` that the grid must grow.
OUTSIDE: Final = -2

# Answer of `blocker` when nothing stands in the way.
CLEAR: Final = -1

# Cells of the padded grid: first row, last row, first column, last column, all included.
Box = tuple[int, int, int, int]
# The box of lost cells when there are none.
NOTHING_LOST: Final[Box] = (0, -1, 0, -1)

_FRACTION: Final = SUBCELLS - 1


@njit(cache=True, nogil=True, inline="always")
def _blocker_at(cells: NDArray[np.int8], width: int, x: int, y: int) -> int:
    """Return a cell that touches a point and is not free, or CLEAR; a point on a border touches two or four cells."""
    index = (y >> SUBCELL_BITS) * width + (x >> SUBCELL_BITS)
    if cells[index] != FREE:
        return index
    on_x = (x & _FRACTION) == 0
    on_y = (y & _FRACTION) == 0
    if on_x and cells[index - 1] != FREE:
        return index - 1
    if on_y:
        if cells[index - width] != FREE:
            return index - width
        if on_x and cells[index - width - 1] != FREE:
            return index - width - 1
    return CLEAR


@njit(cache=True, nogil=True, inline="always")
def may_touch(x0: int, y0: int, x1: int, y1: int, box: Box) -> bool:
    """Whether the bounding box of a segment, in subcells, touches a box of cells (first row, last row, columns)."""
    return (
        min(y0, y1) >> SUBCELL_BITS <= box[1] + 1
        and max(y0, y1) >> SUBCELL_BITS >= box[0]
        and min(x0, x1) >> SUBCELL_BITS <= box[3] + 1
        and max(x0, x1) >> SUBCELL_BITS >= box[2]
    )


@njit(cache=True, nogil=True)
def blocker(cells: NDArray[np.int8], width: int, x0: int, y0: int, x1: int, y1: int) -> int:
    """Return one cell in the way of a straight segment, or CLEAR when every cell that it touches is free.

    A cell is touched when the segment meets its closed square: a segment along a border touches the cells of both
    sides, one through a corner touches all four. So whether the segment is clear does not depend on its direction.

    Args:
        cells: padded grid, flat, int8, shape (height * width,).
        width: cells per row of the padded grid.
        x0: start, subcells, inside the unpadded part (its upper and right border excluded).
        y0: start, subcells.
        x1: end, subcells, under the same condition.
        y1: end, subcells.

    Returns:
        Flat index of a touched cell that is not free, or CLEAR.
    """
    found = _blocker_at(cells, width, x0, y0)
    if found != CLEAR:
        return found
    found = _blocker_at(cells, width, x1, y1)
    if found != CLEAR:
        return found
    if x0 == x1:
        beside = 1 if (x0 & _FRACTION) == 0 else 0
        low, high = min(y0, y1) >> SUBCELL_BITS, max(y0, y1) >> SUBCELL_BITS
        first = low * width + (x0 >> SUBCELL_BITS)
        for index in range(first, first + (high - low) * width + 1, width):
            if cells[index] != FREE:
                return index
            if cells[index - beside] != FREE:
                return index - beside
        return CLEAR
    if y0 == y1:
        beside = width if (y0 & _FRACTION) == 0 else 0
        low, high = min(x0, x1) >> SUBCELL_BITS, max(x0, x1) >> SUBCELL_BITS
        first = (y0 >> SUBCELL_BITS) * width + low
        for index in range(first, first + high - low + 1):
            if cells[index] != FREE:
                return index
            if cells[index - beside] != FREE:
                return index - beside
        return CLEAR
    # The cells whose inside the segment enters first and leaves last; `ahead` is the way to the next border.
    if x1 > x0:
        step_x, run, column, last_column = 1, x1 - x0, x0 >> SUBCELL_BITS, (x1 - 1) >> SUBCELL_BITS
        ahead_x = ((column + 1) << SUBCELL_BITS) - x0
    else:
        step_x, run, column, last_column = -1, x0 - x1, (x0 - 1) >> SUBCELL_BITS, x1 >> SUBCELL_BITS
        ahead_x = x0 - (column << SUBCELL_BITS)
    if y1 > y0:
        step_y, rise, row, last_row = width, y1 - y0, y0 >> SUBCELL_BITS, (y1 - 1) >> SUBCELL_BITS
        ahead_y = ((row + 1) << SUBCELL_BITS) - y0
    else:
        step_y, rise, row, last_row = -width, y0 - y1, (y0 - 1) >> SUBCELL_BITS, y1 >> SUBCELL_BITS
        ahead_y = y0 - (row << SUBCELL_BITS)
    index = row * width + column
    last = last_row * width + last_column
    # Sign of (time of the next vertical border) - (time of the next horizontal border), scaled to integers.
    order = ahead_x * rise - ahead_y * run
    order_x = rise << SUBCELL_BITS
    order_y = run << SUBCELL_BITS
    while index != last:
        if order == 0:
            if cells[index + step_x] != FREE:
                return index + step_x
            if cells[index + step_y] != FREE:
                return index + step_y
            index += step_x + step_y
            order += order_x - order_y
        else:
            # Which border comes next is as good as random: choose without a branch.
            across = order < 0
            index += step_x if across else step_y
            order += order_x if across else -order_y
        if cells[index] != FREE:
            return index
    return CLEAR
