"""Lookouts: places near frontiers that cannot be seen from any viewpoint at its usual place.

One viewpoint stands for a whole piece, so what can be seen from elsewhere in the piece alone, such as from a doorway at
its end, stays unseen. Once nothing else is left, the viewpoint of such a piece moves there; that of a robot with a
radius does so early, as soon as the robot has been in the piece, where no other viewpoint would show the same.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.mapping.clearance import passable
from common.mapping.pieces import Cells, piece_at
from common.mapping.raycast import SUBCELL_BITS, SUBCELLS
from common.mapping.sight import CLEAR, FREE, OCCUPIED, blocker
from common.mapping.squares import Layout
from common.system.jit import njit


class Remains(NamedTuple):
    """What is left to look at, and what makes a place worth a look.

    Attributes:
        frontiers: frontier cells, flat, int32: all of them, or those that nothing else will show.
        weights: how many frontier cells each stands for, int32, see `common.mapping.thinning`.
        range: a place observes frontiers up to so far away, subcells.
        least: a place that observes fewer is no lookout.
    """

    frontiers: NDArray[np.int32]
    weights: NDArray[np.int32]
    range: int
    least: int


@njit(cache=True, nogil=True, inline="always")
def _middle(number: int) -> int:
    """Return the middle of a row or column of cells, subcells."""
    return (number << SUBCELL_BITS) + SUBCELLS // 2


@njit(cache=True, nogil=True)
def _observes_enough(cells: Cells, x: int, y: int, remains: Remains) -> bool:
    """Whether enough frontiers are in range and in sight of a place."""
    width = cells.width
    count = 0
    for k in range(len(remains.frontiers)):
        to_x, to_y = _middle(remains.frontiers[k] % width), _middle(remains.frontiers[k] // width)
        if (to_x - x) ** 2 + (to_y - y) ** 2 <= remains.range * remains.range:
            count += remains.weights[k] * (blocker(cells.belief, width, x, y, to_x, to_y) == CLEAR)
            if count >= remains.least:
                return True
    return False


@njit(cache=True, nogil=True)
def _in_gap(cells: Cells, frontier: int) -> bool:
    """Whether a frontier is all that shows of a passage one cell wide, in which the robot fits."""
    belief, width = cells.belief, cells.width
    if not passable(cells.clear[frontier]):
        return False
    for along, across in ((1, width), (width, 1)):
        left, right = belief[frontier - across], belief[frontier + across]
        ahead, behind = belief[frontier + along], belief[frontier - along]
        if FREE not in (left, right) and OCCUPIED in (left, right) and min(ahead, behind) < FREE:
            return True
    return False


@njit(cache=True, nogil=True)
def _has_been(cells: Cells, row: int, column: int, reach: int) -> bool:
    """Whether the robot has been so near to a place, and in sight of it, that another look shows nothing new."""
    width = cells.width
    height = len(cells.clear) // width
    x, y = _middle(column), _middle(row)
    for r in range(max(row - reach, 1), min(row + reach, height - 2) + 1):
        for c in range(max(column - reach, 1), min(column + reach, width - 2) + 1):
            if cells.been[r * width + c] and blocker(cells.belief, width, _middle(c), _middle(r), x, y) == CLEAR:
                return True
    return False


def nearest_first(reach: int) -> NDArray[np.int32]:
    """Return the offsets of all cells up to so many rows and columns away, nearest first, then row-major.

    Returns:
        Rows and columns, int32, shape ((2 reach + 1)^2, 2); the last is (reach, reach).
    """
    offsets = np.indices((2 * reach + 1,) * 2, dtype=np.int32).reshape(2, -1).T - np.int32(reach)
    return np.ascontiguousarray(offsets[np.argsort((offsets**2).sum(axis=1), kind="stable")])


@njit(cache=True, nogil=True)
def _visited_near(pieces: Any, first_of: NDArray[np.int32], layout: Layout, row: int, column: int, reach: int) -> bool:
    """Whether the robot has been in a piece of a square that holds cells so near to a cell."""
    rows, columns = len(layout.row_of), len(layout.column_of)
    top, left = layout.row_of[max(row - reach, 0)], layout.column_of[max(column - reach, 0)]
    bottom, right = layout.row_of[min(row + reach, rows - 1)], layout.column_of[min(column + reach, columns - 1)]
    for j in range(top, bottom + 1):
        for i in range(left, right + 1):
            piece = first_of[j * len(layout.x) + i]
            while piece >= 0:
                if pieces[piece].visited:
                    return True
                piece = pieces[piece].next
    return False


@njit(cache=True, nogil=True)
def _nearest_clear(cells: Cells, row: int, column: int, around: NDArray[np.int32]) -> int:
    """Return the first clear cell that a cell sees in the order of the offsets, flat; -1 for none."""
    width = cells.width
    height = len(cells.clear) // width
    for k in range(len(around)):
        r, c = row + around[k, 0], column + around[k, 1]
        if not (1 <= r < height - 1 and 1 <= c < width - 1) or not passable(cells.clear[r * width + c]):
            continue
        if blocker(cells.belief, width, _middle(column), _middle(row), _middle(c), _middle(r)) == CLEAR:
            return r * width + c
    return -1


@njit(cache=True, nogil=True)
def find_lookouts(
    cells: Cells,
    layout: Layout,
    pieces: Any,
    first_of: NDArray[np.int32],
    remains: Remains,
    around: NDArray[np.int32],
    been_reach: int,
    everywhere: bool,
    lookouts: NDArray[np.int64],
) -> None:
    """Find for each piece the clear cell nearest to one of the frontiers beside it, where the robot has not been.

    A cell that observes too few frontiers to be useful is passed over, since it would keep the piece's other frontiers
    from their turn; the cells around it stand in for it. In a narrow gap those are needed: from the middle of a
    frontier the next one over the corner is out of sight. A gap one cell wide shows one frontier, which is enough.

    Args:
        cells: of the belief.
        layout: of the squares.
        pieces: all pieces.
        first_of: first piece of each square.
        remains: what is left to look at.
        around: a frontier lies beside clear space so far away, in line of sight, see `nearest_first`.
        been_reach: so many cells around a place where the robot has been, and in sight of it, another look shows
            nothing new.
        everywhere: pieces where the robot has not been move as well.
        lookouts: receives x and y of each piece's place, subcells, int64, shape (pieces, 2); -1 where there is none.
    """
    width = cells.width
    reach = int(around[-1, 0]) + 1
    nearest = np.full(len(pieces), np.int64(1) << 62)
    for frontier in remains.frontiers:
        row, column = frontier // width, frontier % width
        x, y = _middle(column), _middle(row)
        if not (everywhere or _visited_near(pieces, first_of, layout, row, column, reach)):
            continue
        best = _nearest_clear(cells, row, column, around)
        if best < 0 or _has_been(cells, best // width, best % width, been_reach):
            continue
        in_gap = _in_gap(cells, frontier)
        for r in range(best // width - 1, best // width + 2):
            for c in range(best % width - 1, best % width + 2):
                cell = r * width + c
                piece = piece_at(pieces, first_of, cells, layout, cell)
                # The nearest of all, then the first cell: the order of the frontiers plays no part.
                key = ((r - row) ** 2 + (c - column) ** 2) * len(cells.clear) + cell
                if piece < 0 or key >= nearest[piece] or not (everywhere or pieces[piece].visited):
                    continue
                if (
                    blocker(cells.belief, width, x, y, _middle(c), _middle(r)) == CLEAR
                    and not _has_been(cells, r, c, been_reach)
                    and (in_gap or _observes_enough(cells, _middle(c), _middle(r), remains))
                ):
                    nearest[piece] = key
                    lookouts[piece, 0], lookouts[piece, 1] = _middle(c), _middle(r)
