"""Lookouts: places near frontiers that no viewpoint at its usual place shows.

One viewpoint stands for a whole piece, so what can be seen from elsewhere in the piece alone, such as from a doorway at
its end, stays unseen. Once nothing else is left, the viewpoint of such a piece moves there.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.jit import njit
from common.mapping.clearance import passable
from common.mapping.pieces import Cells, piece_at
from common.mapping.raycast import SUBCELL_BITS, SUBCELLS
from common.mapping.sight import CLEAR, blocker
from common.mapping.squares import Layout


@njit(cache=True, nogil=True)
def find_lookouts(
    cells: Cells,
    layout: Layout,
    pieces: Any,
    first_of: NDArray[np.int32],
    frontiers: NDArray[np.int32],
    reach: int,
    been_reach: int,
    everywhere: bool,
    lookouts: NDArray[np.int64],
) -> None:
    """Find for each piece the clear cell nearest to one of the frontiers beside it, where the robot has not been.

    Args:
        cells: of the belief.
        layout: of the squares.
        pieces: all pieces.
        first_of: first piece of each square.
        frontiers: cells, flat, int32.
        reach: a frontier lies beside clear space up to so many cells away, in line of sight.
        been_reach: so many cells around a place where the robot has been, another look shows nothing new.
        everywhere: pieces where the robot has not been move as well.
        lookouts: receives x and y of each piece's place, subcells, int64, shape (pieces, 2); -1 where there is none.
    """
    width = cells.width
    height = len(cells.clear) // width
    nearest = np.full(len(pieces), np.int64(1) << 62)
    for frontier in frontiers:
        row, column = frontier // width, frontier % width
        x, y = (column << SUBCELL_BITS) + SUBCELLS // 2, (row << SUBCELL_BITS) + SUBCELLS // 2
        best, best_far = -1, np.int64(0)
        for r in range(max(row - reach, 1), min(row + reach, height - 2) + 1):
            for c in range(max(column - reach, 1), min(column + reach, width - 2) + 1):
                far = (r - row) ** 2 + (c - column) ** 2
                if (best >= 0 and far >= best_far) or not passable(cells.clear[r * width + c]):
                    continue
                to_x, to_y = (c << SUBCELL_BITS) + SUBCELLS // 2, (r << SUBCELL_BITS) + SUBCELLS // 2
                if blocker(cells.belief, width, x, y, to_x, to_y) == CLEAR:
                    best, best_far = r * width + c, far
        if best < 0:
            continue
        piece = piece_at(pieces, first_of, cells, layout, best)
        if not (everywhere or pieces[piece].visited):
            continue
        row, column = best // width, best % width
        been = False
        for r in range(max(row - been_reach, 1), min(row + been_reach, height - 2) + 1):
            for c in range(max(column - been_reach, 1), min(column + been_reach, width - 2) + 1):
                been |= cells.been[r * width + c]
        # The nearest of all, then the first cell: the order of the frontiers plays no part.
        key = best_far * len(cells.clear) + best
        if not been and key < nearest[piece]:
            nearest[piece] = key
            lookouts[piece, 0] = (column << SUBCELL_BITS) + SUBCELLS // 2
            lookouts[piece, 1] = (row << SUBCELL_BITS) + SUBCELLS // 2
