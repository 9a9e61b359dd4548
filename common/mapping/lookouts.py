"""Lookouts: places near frontiers that no viewpoint at its usual place shows.

One viewpoint stands for a whole piece, so what can be seen from elsewhere in the piece alone, such as from a doorway at
its end, stays unseen. Once nothing else is left, the viewpoint of such a piece moves there.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.jit import njit
from common.mapping.clearance import passable
from common.mapping.pieces import Cells, piece_at
from common.mapping.raycast import SUBCELL_BITS, SUBCELLS
from common.mapping.sight import CLEAR, FREE, OCCUPIED, blocker
from common.mapping.squares import Layout


class Remains(NamedTuple):
    """What is left to look at, and what makes a place worth a look.

    Attributes:
        frontiers: all frontier cells, flat, int32.
        range: a place observes frontiers up to so far away, subcells.
        least: a place that observes fewer is no lookout.
    """

    frontiers: NDArray[np.int32]
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
    for frontier in remains.frontiers:
        to_x, to_y = _middle(frontier % width), _middle(frontier // width)
        if (to_x - x) ** 2 + (to_y - y) ** 2 <= remains.range * remains.range:
            count += blocker(cells.belief, width, x, y, to_x, to_y) == CLEAR
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


@njit(cache=True, nogil=True)
def find_lookouts(
    cells: Cells,
    layout: Layout,
    pieces: Any,
    first_of: NDArray[np.int32],
    remains: Remains,
    reach: int,
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
        reach: a frontier lies beside clear space up to so many cells away, in line of sight.
        been_reach: so many cells around a place where the robot has been, and in sight of it, another look shows
            nothing new.
        everywhere: pieces where the robot has not been move as well.
        lookouts: receives x and y of each piece's place, subcells, int64, shape (pieces, 2); -1 where there is none.
    """
    width = cells.width
    height = len(cells.clear) // width
    nearest = np.full(len(pieces), np.int64(1) << 62)
    for frontier in remains.frontiers:
        row, column = frontier // width, frontier % width
        x, y = _middle(column), _middle(row)
        best, best_far = -1, np.int64(0)
        for r in range(max(row - reach, 1), min(row + reach, height - 2) + 1):
            for c in range(max(column - reach, 1), min(column + reach, width - 2) + 1):
                far = (r - row) ** 2 + (c - column) ** 2
                if (best >= 0 and far >= best_far) or not passable(cells.clear[r * width + c]):
                    continue
                if blocker(cells.belief, width, x, y, _middle(c), _middle(r)) == CLEAR:
                    best, best_far = r * width + c, far
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
