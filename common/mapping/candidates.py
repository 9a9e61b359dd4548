"""Straight edges: pairs of viewpoints near enough for one, and whether the line between them is clear.

Every pair stands once, in the list of the viewpoint whose square comes first, row-major. A pair in line stays so as
long as no cell near the line was lost, and a blocked pair as long as the blocking cell is not clear, so an update tests
a line only when its answer can have changed.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from common.mapping.pieces import Cells
from common.mapping.sight import CLEAR, FREE, Box, blocker, may_touch
from common.mapping.squares import Layout
from common.system.jit import njit

# An edge reaches so many squares over rows and columns; on a lattice, the 20 nearest lie within sqrt(5) spacings there.
REACH_SQUARES: Final = 2
IN_LINE: Final = CLEAR


@njit(cache=True, nogil=True, inline="always")
def _comes_first(dj: int, di: int) -> bool:
    """Whether a square comes before the one that lies (dj, di) squares on."""
    return dj > 0 or (dj == 0 and di > 0)


@njit(cache=True, nogil=True)
def forget_pairs(
    pieces: Any,
    first_of: NDArray[np.int32],
    layout: Layout,
    ended: NDArray[np.int32],
    count: NDArray[np.int32],
    other: NDArray[np.int32],
    state: NDArray[np.int32],
) -> None:
    """Take viewpoints out of their own lists and out of those of the squares before their own."""
    rows, columns = len(layout.y), len(layout.x)
    for piece in ended:
        j, i = pieces[piece].square // columns, pieces[piece].square % columns
        count[piece] = 0
        pieces[piece].listed = False
        for dj in range(-REACH_SQUARES, 1):
            for di in range(-REACH_SQUARES, REACH_SQUARES + 1):
                if not _comes_first(-dj, -di) or not (0 <= j + dj < rows and 0 <= i + di < columns):
                    continue
                owner = first_of[(j + dj) * columns + i + di]
                while owner >= 0:
                    for k in range(count[owner]):
                        if other[owner, k] == piece:
                            count[owner] -= 1
                            other[owner, k] = other[owner, count[owner]]
                            state[owner, k] = state[owner, count[owner]]
                            break
                    owner = pieces[owner].next


@njit(cache=True, nogil=True)
def most_pairs(pieces: Any, first_of: NDArray[np.int32], layout: Layout, fresh: NDArray[np.int32]) -> int:
    """Return how long a list can be once some viewpoints are listed: viewpoints of the squares around, at most."""
    rows, columns = len(layout.y), len(layout.x)
    most = 0
    for piece in fresh:
        j, i = pieces[piece].square // columns, pieces[piece].square % columns
        # Squares whose lists the viewpoint joins lie up to two away; theirs reach two farther.
        for top in range(max(j - REACH_SQUARES, 0), j + 1):
            for left in range(max(i - REACH_SQUARES, 0), min(i + REACH_SQUARES, columns - 1) + 1):
                total = 0
                for row in range(top, min(top + REACH_SQUARES, rows - 1) + 1):
                    for column in range(max(left - REACH_SQUARES, 0), min(left + REACH_SQUARES, columns - 1) + 1):
                        there = first_of[row * columns + column]
                        while there >= 0:
                            total += pieces[there].exists
                            there = pieces[there].next
                most = max(most, total)
    return most


@njit(cache=True, nogil=True)
def list_pairs(
    cells: Cells,
    pieces: Any,
    first_of: NDArray[np.int32],
    layout: Layout,
    fresh: NDArray[np.int32],
    reach: int,
    count: NDArray[np.int32],
    other: NDArray[np.int32],
    state: NDArray[np.int32],
) -> None:
    """Pair new viewpoints with all those near enough that are listed already, and test the lines.

    Args:
        cells: of the belief.
        pieces: all pieces.
        first_of: first piece of each square.
        layout: of the squares.
        fresh: pieces whose viewpoints are not listed yet.
        reach: the longest straight edge, subcells.
        count: length of each list, int32.
        other: second viewpoint of each pair, int32, shape (pieces, most).
        state: IN_LINE or a blocking cell, int32, same shape.
    """
    rows, columns = len(layout.y), len(layout.x)
    for piece in fresh:
        x, y, square = pieces[piece].x, pieces[piece].y, pieces[piece].square
        j, i = square // columns, square % columns
        for dj in range(-REACH_SQUARES, REACH_SQUARES + 1):
            for di in range(-REACH_SQUARES, REACH_SQUARES + 1):
                # Pieces of one square do not see each other: the line would lie inside the square, and join them.
                if (dj == 0 and di == 0) or not (0 <= j + dj < rows and 0 <= i + di < columns):
                    continue
                there = first_of[(j + dj) * columns + i + di]
                while there >= 0:
                    if pieces[there].listed:
                        to_x, to_y = pieces[there].x, pieces[there].y
                        if (to_x - x) ** 2 + (to_y - y) ** 2 <= reach * reach:
                            owner, second = (piece, there) if _comes_first(dj, di) else (there, piece)
                            other[owner, count[owner]] = second
                            state[owner, count[owner]] = blocker(cells.clear, cells.width, x, y, to_x, to_y)
                            count[owner] += 1
                    there = pieces[there].next
        pieces[piece].listed = True


@njit(cache=True, nogil=True)
def update_pairs(
    cells: Cells,
    pieces: Any,
    first_of: NDArray[np.int32],
    layout: Layout,
    changed: Box,
    lost: Box,
    count: NDArray[np.int32],
    other: NDArray[np.int32],
    state: NDArray[np.int32],
) -> None:
    """Bring the pairs up to date that a box of cells with another clearance can touch.

    Args:
        cells: of the belief.
        pieces: all pieces.
        first_of: first piece of each square.
        layout: of the squares.
        changed: box of all cells whose clearance changed.
        lost: box of those that are worse than before; its second number is -1 when there are none.
        count: length of each list, int32.
        other: second viewpoint of each pair, int32.
        state: IN_LINE or a blocking cell, int32; brought up to date.
    """
    columns = len(layout.x)
    any_lost = lost[1] >= 0
    # A line touches a cell when it runs along its border, too.
    top = max(layout.row_of[changed[0] - 1] - REACH_SQUARES, 0)
    bottom = layout.row_of[changed[1] + 1]
    left = max(layout.column_of[changed[2] - 1] - REACH_SQUARES, 0)
    right = min(layout.column_of[changed[3] + 1] + REACH_SQUARES, columns - 1)
    for j in range(top, bottom + 1):
        for i in range(left, right + 1):
            piece = first_of[j * columns + i]
            while piece >= 0:
                for k in range(count[piece]):
                    x0, y0 = pieces[piece].x, pieces[piece].y
                    x1, y1 = pieces[other[piece, k]].x, pieces[other[piece, k]].y
                    if state[piece, k] == IN_LINE:
                        if not (any_lost and may_touch(x0, y0, x1, y1, lost)):
                            continue
                    elif cells.clear[state[piece, k]] != FREE:
                        continue
                    state[piece, k] = blocker(cells.clear, cells.width, x0, y0, x1, y1)
                piece = pieces[piece].next
