"""Pieces: the connected parts of clear space inside each lattice square, each of which one viewpoint stands for."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.mapping.clearance import passable
from common.mapping.raycast import SUBCELL_BITS, SUBCELLS
from common.mapping.sight import CLEAR, OCCUPIED, blocker
from common.mapping.squares import Layout
from common.system.jit import njit

PIECE: Final = np.dtype(
    [
        ("x", np.int64),  # the viewpoint's place, subcells of the padded grid; -1 while it has none
        ("y", np.int64),
        ("square", np.int32),  # flat number of its square
        ("label", np.int32),  # number among the pieces of its square, from 1
        ("next", np.int32),  # the next piece of its square, -1 at the end
        ("cell", np.int32),  # its first cell, flat
        ("alive", np.bool_),
        ("centred", np.bool_),  # its viewpoint is the lattice point
        ("waits", np.bool_),  # of a square that is only partly seen, so that it may soon be another piece
        ("visited", np.bool_),
        ("exists", np.bool_),  # it has a viewpoint
        ("lookout", np.bool_),  # it has one near frontiers instead of at its usual place
        ("listed", np.bool_),  # its viewpoint stands in the lists of possible edges
    ],
    align=True,
)
NOWHERE: Final = -1


class Cells(NamedTuple):
    """Grids over all cells of one generation of the belief, padded, flat.

    Attributes:
        belief: what is known, int8.
        clear: where the robot fits, int8, see `Clearance`.
        labels: number of the piece within its square, from 1, 0 where no piece is, uint16.
        been: cells at whose viewpoints the robot has been, bool.
        width: cells per row.
    """

    belief: NDArray[np.int8]
    clear: NDArray[np.int8]
    labels: NDArray[np.uint16]
    been: NDArray[np.bool_]
    width: int


@njit(cache=True, nogil=True)
def label_square(cells: Cells, layout: Layout, j: int, i: int, stack: NDArray[np.int32]) -> int:
    """Number the pieces of a square in the order of their first cells, row-major; return how many there are."""
    width, clear, labels = cells.width, cells.clear, cells.labels
    row_low, row_high = layout.row_begin[j], layout.row_begin[j + 1] - 1
    column_low, column_high = layout.column_begin[i], layout.column_begin[i + 1] - 1
    size = 0
    for row in range(row_low, row_high + 1):
        for cell in range(row * width + column_low, row * width + column_high + 1):
            labels[cell] = passable(clear[cell])
            size += labels[cell]
    # Most squares are one piece or none.
    if size == (row_high - row_low + 1) * (column_high - column_low + 1):
        return 1
    if size == 0:
        return 0
    for row in range(row_low, row_high + 1):
        labels[row * width + column_low : row * width + column_high + 1] = 0
    count = 0
    for row in range(row_low, row_high + 1):
        for start in range(row * width + column_low, row * width + column_high + 1):
            if labels[start] or not passable(clear[start]):
                continue
            count += 1
            stack[0] = start
            size = 1
            while size:
                size -= 1
                cell = stack[size]
                if labels[cell]:
                    continue
                # All of a run of cells in a row, then one cell of each run that touches it in the rows beside.
                r = cell // width
                left, right = cell, cell
                while left > r * width + column_low and passable(clear[left - 1]):
                    left -= 1
                while right < r * width + column_high and passable(clear[right + 1]):
                    right += 1
                for there in range(left, right + 1):
                    labels[there] = count
                for beside in (-width if r > row_low else 0, width if r < row_high else 0):
                    inside = False
                    for there in range(left + beside, right + beside + 1):
                        opens = labels[there] == 0 and passable(clear[there])
                        if opens and not inside:
                            stack[size] = there
                            size += 1
                        inside = opens
    return count


@njit(cache=True, nogil=True)
def _margins(cells: Cells, layout: Layout, j: int, i: int, most: int) -> NDArray[np.int16]:
    """Return, for every cell of a square, how many steps (king's moves) away space is blocked, at most ``most``."""
    width, clear = cells.width, cells.clear
    height = len(clear) // width
    top, left = max(layout.row_begin[j] - most, 0), max(layout.column_begin[i] - most, 0)
    bottom = min(layout.row_begin[j + 1] - 1 + most, height - 1)
    right = min(layout.column_begin[i + 1] - 1 + most, width - 1)
    rows, columns = bottom - top + 1, right - left + 1
    # One ring more, so that no cell needs a bounds check.
    steps = np.full((rows + 2, columns + 2), most, dtype=np.int16)
    for r in range(1, rows + 1):
        for c in range(1, columns + 1):
            if not passable(clear[(top + r - 1) * width + left + c - 1]):
                steps[r, c] = 0
                continue
            before = min(steps[r - 1, c - 1], steps[r - 1, c], steps[r - 1, c + 1], steps[r, c - 1])
            steps[r, c] = min(before + 1, most)
    for r in range(rows, 0, -1):
        for c in range(columns, 0, -1):
            after = min(steps[r + 1, c + 1], steps[r + 1, c], steps[r + 1, c - 1], steps[r, c + 1])
            steps[r, c] = min(steps[r, c], after + 1)
    row, column = layout.row_begin[j] - top + 1, layout.column_begin[i] - left + 1
    return steps[
        row : row + layout.row_begin[j + 1] - layout.row_begin[j],
        column : column + layout.column_begin[i + 1] - layout.column_begin[i],
    ]


@njit(cache=True, nogil=True)
def best_place(cells: Cells, layout: Layout, j: int, i: int, label: int, most: int) -> tuple[np.int64, np.int64]:
    """Return the middle of the cell of a piece that has most space around, then is nearest to the square's centre.

    Args:
        cells: of the belief.
        layout: of the squares.
        j: row of the square.
        i: its column.
        label: number of the piece.
        most: cells of space around that count at most: enough is as good as plenty.

    Returns:
        x and y, subcells.
    """
    margins = _margins(cells, layout, j, i, most)
    rows, columns = margins.shape
    best_margin, best_far = -1, np.int64(0)
    best_x, best_y = np.int64(0), np.int64(0)
    for r in range(rows):
        row = layout.row_begin[j] + r
        for c in range(columns):
            column = layout.column_begin[i] + c
            if cells.labels[row * cells.width + column] != label or margins[r, c] < best_margin:
                continue
            x = (column << SUBCELL_BITS) + SUBCELLS // 2
            y = (row << SUBCELL_BITS) + SUBCELLS // 2
            far = (x - layout.x[i]) ** 2 + (y - layout.y[j]) ** 2
            if margins[r, c] > best_margin or far < best_far:
                best_margin, best_far = margins[r, c], far
                best_x, best_y = x, y
    return best_x, best_y


@njit(cache=True, nogil=True)
def centre_label(cells: Cells, layout: Layout, j: int, i: int) -> int:
    """Return the number of the piece that holds a square's lattice point, 0 when that point is not clear."""
    x, y = layout.x[i], layout.y[j]
    row, column = y >> SUBCELL_BITS, x >> SUBCELL_BITS
    width = cells.width
    if not (1 <= row < len(cells.clear) // width - 1 and 1 <= column < width - 1):
        return 0
    if blocker(cells.clear, width, x, y, x, y) != CLEAR:
        return 0
    return cells.labels[row * width + column]


@njit(cache=True, nogil=True)
def survey(
    cells: Cells,
    layout: Layout,
    j: int,
    i: int,
    first: NDArray[np.int32],
    visited: NDArray[np.bool_],
) -> bool:
    """Find the first cell of each piece of a square, and those where the robot has been; both by number, from 1.

    Returns:
        Whether the square's pieces are what they will stay, nearly: a wall was seen in it, or nothing is unknown.
    """
    width, labels = cells.width, cells.labels
    # What lies outside the grid is unknown.
    wall, unknown = False, not (layout.row_whole[j] and layout.column_whole[i])
    left, right = layout.column_begin[i], layout.column_begin[i + 1]
    missing = len(first) - 1
    for row in range(layout.row_begin[j], layout.row_begin[j + 1]):
        begin, end = row * width + left, row * width + right
        # Loops without branches, which take several cells at a time.
        been = False
        for cell in range(begin, end):
            wall |= cells.belief[cell] == OCCUPIED
            unknown |= cells.belief[cell] < 0
            been |= cells.been[cell]
        for cell in range(begin, end if missing or been else begin):
            label = labels[cell]
            if label:
                if first[label] < 0:
                    first[label] = cell
                    missing -= 1
                visited[label] |= cells.been[cell]
    return wall or not unknown


@njit(cache=True, nogil=True)
def piece_at(pieces: Any, first_of: NDArray[np.int32], cells: Cells, layout: Layout, cell: int) -> int:
    """Return the piece that holds a cell, -1 where none does."""
    label = cells.labels[cell]
    if label == 0:
        return -1
    j, i = layout.row_of[cell // cells.width], layout.column_of[cell % cells.width]
    piece = first_of[j * len(layout.x) + i]
    while piece >= 0 and pieces[piece].label != label:
        piece = pieces[piece].next
    return piece


@njit(cache=True, nogil=True)
def cells_of_nodes(
    pieces: Any, first_of: NDArray[np.int32], cells: Cells, layout: Layout, numbers: NDArray[np.int32]
) -> NDArray[np.bool_]:
    """Return which cells belong to pieces that are nodes, bool, flat; ``numbers`` has the node of each piece or -1."""
    width, columns = cells.width, len(layout.x)
    inside = np.zeros(len(cells.labels), dtype=np.bool_)
    for square in range(len(first_of)):
        j, i = square // columns, square % columns
        piece = first_of[square]
        while piece >= 0:
            label = pieces[piece].label if numbers[piece] >= 0 else 0
            for row in range(layout.row_begin[j], layout.row_begin[j + 1] if label else 0):
                for column in range(layout.column_begin[i], layout.column_begin[i + 1]):
                    inside[row * width + column] |= cells.labels[row * width + column] == label
            piece = pieces[piece].next
    return inside
