"""Where a robot stands: the clear cell and the piece that count as its own, even from beside clear space."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from common.jit import njit
from common.mapping.clearance import SWEEP_TOLERANCE, passable, sweep
from common.mapping.pieces import NOWHERE, Cells, piece_at
from common.mapping.raycast import SUBCELL_BITS, SUBCELLS
from common.mapping.settling import usual_place
from common.mapping.sight import CLEAR, blocker
from common.mapping.squares import Layout

# A robot beside clear space is taken to the nearest clear cell within this, metres beyond its radius.
MARGIN_REACH: Final = 0.5


@njit(cache=True, nogil=True)
def nearest_clear(cells: Cells, x: int, y: int, most: int) -> int:
    """Return the nearest passable cell that a point in the margin of clear space can be driven to, flat, -1 for none.

    The line to the middle of the cell is free, and comes no nearer to what is not than the point is, if there is such a
    cell.
    """
    width = cells.width
    height = len(cells.clear) // width
    row, column = y >> SUBCELL_BITS, x >> SUBCELL_BITS
    from_x, from_y = x / SUBCELLS, y / SUBCELLS
    gap = sweep(cells.belief, width, from_x, from_y, from_x, from_y, float(most))
    best, best_far, best_keeps = -1, 0, False
    for r in range(max(row - most, 1), min(row + most, height - 2) + 1):
        for c in range(max(column - most, 1), min(column + most, width - 2) + 1):
            if not passable(cells.clear[r * width + c]):
                continue
            to_x = (c << SUBCELL_BITS) + SUBCELLS // 2
            to_y = (r << SUBCELL_BITS) + SUBCELLS // 2
            far = (to_x - x) ** 2 + (to_y - y) ** 2
            if best >= 0 and best_keeps and far >= best_far:
                continue
            if blocker(cells.belief, width, x, y, to_x, to_y) != CLEAR:
                continue
            around = sweep(cells.belief, width, from_x, from_y, to_x / SUBCELLS, to_y / SUBCELLS, gap)
            keeps = around >= gap - SWEEP_TOLERANCE
            if best < 0 or (keeps and not best_keeps) or (keeps == best_keeps and far < best_far):
                best, best_far, best_keeps = r * width + c, far, keeps
    return best


@njit(cache=True, nogil=True)
def cell_for(cells: Cells, x: int, y: int, most: int) -> int:
    """Return the clear cell that holds a point, or else the nearest that the point sees, flat; -1 for none."""
    # A place on the border of squares belongs to the first of them: of equally near viewpoints it has the lower number.
    row, column = (y - 1) >> SUBCELL_BITS, (x - 1) >> SUBCELL_BITS
    if not (1 <= row < len(cells.clear) // cells.width - 1 and 1 <= column < cells.width - 1):
        return NOWHERE
    cell = row * cells.width + column
    return cell if cells.labels[cell] else nearest_clear(cells, x, y, most)


@njit(cache=True, nogil=True)
def piece_of(cells: Cells, layout: Layout, pieces: Any, first_of: NDArray[np.int32], x: int, y: int, most: int) -> int:
    """Return the piece that holds a point, or the nearest clear cell that the point sees; -1 for none."""
    cell = cell_for(cells, x, y, most)
    return piece_at(pieces, first_of, cells, layout, cell) if cell >= 0 else NOWHERE


@njit(cache=True, nogil=True)
def pieces_at(
    cells: Cells,
    layout: Layout,
    pieces: Any,
    first_of: NDArray[np.int32],
    x: NDArray[np.int64],
    y: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Return the piece that holds each point, -1 where none does."""
    height = len(cells.clear) // cells.width
    found = np.full(len(x), NOWHERE, dtype=np.int64)
    for k in range(len(x)):
        row, column = y[k] >> SUBCELL_BITS, x[k] >> SUBCELL_BITS
        if 1 <= row < height - 1 and 1 <= column < cells.width - 1:
            found[k] = piece_at(pieces, first_of, cells, layout, row * cells.width + column)
    return found


@njit(cache=True, nogil=True)
def locate(
    cells: Cells,
    layout: Layout,
    pieces: Any,
    first_of: NDArray[np.int32],
    robot: tuple[int, int],
    most: int,
    visit_reach: int,
    margin: int,
) -> int:
    """Return the robot's piece; note that the robot has been there when it is near enough to the viewpoint."""
    x, y = robot
    piece = piece_of(cells, layout, pieces, first_of, x, y, most)
    if piece < 0:
        return piece
    p = pieces[piece]
    if not p.visited:
        place_x, place_y = usual_place(cells, layout, pieces, piece, margin)
        if (place_x - x) ** 2 + (place_y - y) ** 2 <= visit_reach * visit_reach:
            p.visited = True
            cells.been[(place_y >> SUBCELL_BITS) * cells.width + (place_x >> SUBCELL_BITS)] = True
    return piece
