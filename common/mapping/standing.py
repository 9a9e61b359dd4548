"""Where a robot stands: the clear cell and the piece that count as its own, even just outside clear space."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from common.mapping.clearance import SWEEP_TOLERANCE, passable, sweep
from common.mapping.pieces import NOWHERE, Cells, piece_at
from common.mapping.raycast import SUBCELL_BITS, SUBCELLS, cell_middle
from common.mapping.settling import usual_place
from common.mapping.sight import CLEAR, FREE, blocker
from common.mapping.squares import Layout
from common.system.jit import njit

# A robot beside clear space is taken to the nearest clear cell within this, metres beyond its radius.
MARGIN_REACH: Final = 0.5
# A way out of the margin begins with a straight line so many cells far at most.
_FIRST_REACH: Final = 2


@njit(cache=True, nogil=True)
def _straight_out(cells: Cells, x: int, y: int, most: int, gap: float) -> tuple[int, bool]:
    """Return the nearest passable cell in a free line, and whether the line keeps a gap; those that do come first."""
    width = cells.width
    height = len(cells.clear) // width
    row, column = y >> SUBCELL_BITS, x >> SUBCELL_BITS
    best, best_far, best_keeps = NOWHERE, 0, False
    for r in range(max(row - most, 1), min(row + most, height - 2) + 1):
        for c in range(max(column - most, 1), min(column + most, width - 2) + 1):
            if not passable(cells.clear[r * width + c]):
                continue
            to_x, to_y = cell_middle(r * width + c, width)
            far = (to_x - x) ** 2 + (to_y - y) ** 2
            if best >= 0 and best_keeps and far >= best_far:
                continue
            if blocker(cells.belief, width, x, y, to_x, to_y) != CLEAR:
                continue
            keeps = _keeps(cells, x, y, to_x, to_y, gap)
            if best < 0 or (keeps and not best_keeps) or (keeps == best_keeps and far < best_far):
                best, best_far, best_keeps = r * width + c, far, keeps
    return best, best_keeps


@njit(cache=True, nogil=True)
def _keeps(cells: Cells, x0: int, y0: int, x1: int, y1: int, gap: float) -> bool:
    """Whether a segment comes no nearer than a gap, in cells, to what is not free."""
    ends = x0 / SUBCELLS, y0 / SUBCELLS, x1 / SUBCELLS, y1 / SUBCELLS
    return sweep(cells.belief, cells.width, ends[0], ends[1], ends[2], ends[3], gap) >= gap - SWEEP_TOLERANCE


@njit(cache=True, nogil=True)
def _bent_out(cells: Cells, x: int, y: int, most: int, gap: float) -> NDArray[np.int32]:
    """Return the cells of a way to a passable one that keeps a gap, the passable one first; none where there is no way.

    The way leads straight to the middle of a cell nearby and from there in the fewest steps over common sides. A step
    keeps what its two ends keep: along an axis no cell is nearer to a point between them than to both.
    """
    width = cells.width
    height = len(cells.clear) // width
    row, column = y >> SUBCELL_BITS, x >> SUBCELL_BITS
    top, bottom = max(row - most, 1), min(row + most, height - 2)
    left, right = max(column - most, 1), min(column + most, width - 2)
    span = right - left + 1
    # For each cell of the window the one before it, itself at the beginning; -1 while it was not reached.
    before = np.full((bottom - top + 1) * span, -1, dtype=np.int32)
    queue = np.empty(len(before), dtype=np.int32)
    size = 0
    for r in range(max(row - _FIRST_REACH, top), min(row + _FIRST_REACH, bottom) + 1):
        for c in range(max(column - _FIRST_REACH, left), min(column + _FIRST_REACH, right) + 1):
            to_x, to_y = cell_middle(r * width + c, width)
            if _keeps(cells, x, y, to_x, to_y, gap) and blocker(cells.belief, width, x, y, to_x, to_y) == CLEAR:
                here = (r - top) * span + c - left
                before[here] = queue[size] = here
                size += 1
    at = 0
    while at < size:
        here = queue[at]
        at += 1
        r, c = here // span + top, here % span + left
        if passable(cells.clear[r * width + c]):
            way = np.empty(len(before), dtype=np.int32)
            way[0] = r * width + c
            count = 1
            while before[here] != here:
                here = before[here]
                way[count] = (here // span + top) * width + here % span + left
                count += 1
            return way[:count].copy()
        for down, across in ((-1, 0), (0, -1), (0, 1), (1, 0)):
            if not (top <= r + down <= bottom and left <= c + across <= right):
                continue
            there = here + down * span + across
            cell = (r + down) * width + c + across
            to_x, to_y = cell_middle(cell, width)
            if before[there] < 0 and cells.belief[cell] == FREE and _keeps(cells, to_x, to_y, to_x, to_y, gap):
                before[there] = here
                queue[size] = there
                size += 1
    return queue[:0]


@njit(cache=True, nogil=True)
def way_out(cells: Cells, x: int, y: int, most: int) -> NDArray[np.int32]:
    """Return the cells whose middles lead a point in the margin of clear space there, flat, int32; none without a way.

    Straight to the nearest passable cell where that comes no nearer to what is not free than the point is; else over
    other cells where a way round keeps that; else straight through what is free.
    """
    gap = sweep(cells.belief, cells.width, x / SUBCELLS, y / SUBCELLS, x / SUBCELLS, y / SUBCELLS, float(most))
    nearest, keeps = _straight_out(cells, x, y, most, gap)
    if not keeps and gap > 0.0:
        way = _bent_out(cells, x, y, most, gap)
        if len(way):
            return way[::-1].copy()
    return np.full(1 if nearest >= 0 else 0, nearest, dtype=np.int32)


@njit(cache=True, nogil=True)
def nearest_clear(cells: Cells, x: int, y: int, most: int) -> int:
    """Return the passable cell that `way_out` leads to, flat, -1 for none."""
    way = way_out(cells, x, y, most)
    return way[-1] if len(way) else NOWHERE


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
