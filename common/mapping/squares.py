"""The lattice as squares: which cells of the belief's grid belong to which lattice point."""

from __future__ import annotations

from math import ceil, floor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.mapping.cell_grid import AnchoredGrid
from common.mapping.raycast import SUBCELL_BITS, SUBCELLS
from common.system.jit import njit


class Layout(NamedTuple):
    """The squares of one generation of the belief, as kernels want them.

    Square (j, i) has the lattice point (x[i], y[j]) in its middle, and holds the cells whose centres are nearer to it
    than to any other: rows ``row_begin[j]`` to ``row_begin[j + 1] - 1`` of the padded grid, likewise columns. A lattice
    point itself may lie outside the grid.

    Attributes:
        x: of the lattice points, subcells of the padded grid, int64, shape (columns,), ascending.
        y: likewise, shape (rows,).
        row_begin: first row of cells of each row of squares, then the end, int64, shape (rows + 1,).
        column_begin: first column of cells of each column of squares, then the end, int64, shape (columns + 1,).
        row_of: row of squares of each row of the padded grid, int32; those of its ring belong to the nearest.
        column_of: column of squares of each column of the padded grid, likewise.
        row_whole: rows of squares that end nowhere outside the grid, bool, shape (rows,).
        column_whole: columns of squares, likewise.
        margin: cells beside a square that matter to it, at most its side.
    """

    x: NDArray[np.int64]
    y: NDArray[np.int64]
    row_begin: NDArray[np.int64]
    column_begin: NDArray[np.int64]
    row_of: NDArray[np.int32]
    column_of: NDArray[np.int32]
    row_whole: NDArray[np.bool_]
    column_whole: NDArray[np.bool_]
    margin: int


@njit(cache=True, nogil=True, inline="always")
def mark(layout: Layout, row: int, column: int, dirty: NDArray[np.bool_], beside: NDArray[np.bool_]) -> None:
    """Note that a cell changed: of its square, and of those whose margin it lies in."""
    row_of, column_of, margin = layout.row_of, layout.column_of, layout.margin
    dirty[row_of[row], column_of[column]] = True
    bottom, top = row_of[max(row - margin, 0)], row_of[min(row + margin, len(row_of) - 1)]
    left, right = column_of[max(column - margin, 0)], column_of[min(column + margin, len(column_of) - 1)]
    beside[bottom, left] = True
    beside[bottom, right] = True
    beside[top, left] = True
    beside[top, right] = True


@njit(cache=True, nogil=True)
def mark_all(layout: Layout, cells: NDArray[np.int64], dirty: NDArray[np.bool_], beside: NDArray[np.bool_]) -> None:
    """Note that cells changed, given by their flat numbers in the padded grid; see `mark`."""
    width = len(layout.column_of)
    for cell in cells:
        mark(layout, cell // width, cell % width, dirty, beside)


def undivided(rows: int, columns: int) -> Layout:
    """Return one square over a padded grid of so many rows and columns, for those who want no squares."""
    point, whole = np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.bool_)
    row_begin, column_begin = np.array([[1, rows - 1], [1, columns - 1]], dtype=np.int64)
    row_of, column_of = np.zeros(rows, dtype=np.int32), np.zeros(columns, dtype=np.int32)
    return Layout(point, point, row_begin, column_begin, row_of, column_of, whole, whole, 0)


def lay_out(
    belief: AnchoredGrid, lattice_origin: tuple[float, float], spacing: float, margin: int
) -> tuple[Layout, tuple[int, int]]:
    """Lay squares over the belief's grid.

    Args:
        belief: its grid as it is allocated now.
        lattice_origin: (x, y) of one lattice point, metres.
        spacing: side of the squares, metres.
        margin: cells beside a square that matter to it.

    Returns:
        The squares, and the numbers (i, j) of the lattice point of square (0, 0), which outlive a growth of the grid.
    """
    rows, columns = belief.shape
    x, column_begin, column_of, column_whole, i = _axis(belief, lattice_origin, spacing, 0, columns)
    y, row_begin, row_of, row_whole, j = _axis(belief, lattice_origin, spacing, 1, rows)
    return Layout(x, y, row_begin, column_begin, row_of, column_of, row_whole, column_whole, margin), (i, j)


def _axis(
    belief: AnchoredGrid, lattice_origin: tuple[float, float], spacing: float, axis: int, cells: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int32], NDArray[np.bool_], int]:
    """Return lattice points, beginnings, square of each cell, whole squares, number of the first point on one axis."""
    low = (belief.origin[axis] - lattice_origin[axis]) / spacing
    numbers = range(floor(low) - 1, ceil(low + cells * belief.resolution / spacing) + 2)
    values = [lattice_origin[axis] + spacing * k for k in numbers]
    points = np.array([belief.subcells((v, v))[axis] for v in values], dtype=np.int64)
    centres = (np.arange(cells + 2, dtype=np.int64) << SUBCELL_BITS) + SUBCELLS // 2
    # Doubled, so that the middle between two points is a whole number.
    of_cell = np.searchsorted(points[:-1] + points[1:], 2 * centres, side="right")
    before, square, after = of_cell[:1], of_cell[1:-1], of_cell[-1:]
    first, last = (int(square[0]), int(square[-1])) if cells else (0, 0)
    begin = 1 + np.searchsorted(square, np.arange(first, last + 2))
    inside = np.clip(of_cell, first, last) - first
    numbers_of = np.arange(first, last + 1)
    whole = (numbers_of != before) & (numbers_of != after)
    return points[first : last + 1], begin.astype(np.int64), inside.astype(np.int32), whole, numbers[first]
