"""Clear space: the known free cells where a robot of some radius fits, kept up to date where the belief changed."""

from __future__ import annotations

from math import ceil
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.mapping.cell_grid import CellGrid
from common.mapping.sight import FREE, Box
from common.mapping.squares import Layout, mark, undivided
from common.system.jit import njit

# Every point of the cell is clear; the same number as FREE, so that `common.mapping.sight.blocker` reads both grids.
CLEAR_CELL: Final = FREE
# The centre of the cell is clear: the robot may pass from centre to centre.
TIGHT: Final = 1
BLOCKED: Final = 2
# Rounding of metres to cells must not decide whether a cell is clear, cells.
_TOLERANCE: Final = 1e-9
_FAR: Final = 255
# Positions are whole subcells: what keeps a distance exactly may miss it by a few of them, cells.
SWEEP_TOLERANCE: Final = 1e-4


@njit(cache=True, nogil=True, inline="always")
def passable(value: int) -> bool:
    """Whether the robot's centre may be in the middle of a cell; negative values of a belief are not."""
    return (value & -2) == 0


@njit(cache=True, nogil=True)
def _update(
    cells: NDArray[np.int8],
    clear: NDArray[np.int8],
    tight_span: NDArray[np.int16],
    clear_span: NDArray[np.int16],
    changed: Box,
    layout: Layout,
    dirty: NDArray[np.bool_],
    beside: NDArray[np.bool_],
) -> tuple[int, int, int, int, int, int, int, int]:
    """Recompute the cells that a box of changed cells can touch.

    Args:
        cells: padded grid of the belief, int8, shape (height, width).
        clear: CLEAR_CELL, TIGHT or BLOCKED, int8, same shape; brought up to date.
        tight_span: a cell is not TIGHT when a cell that is not free lies this many columns or fewer away, for each
            row offset from -reach to reach, int16; -1 for none.
        clear_span: likewise for CLEAR_CELL.
        changed: box of changed cells.
        layout: of the squares.
        dirty: squares with changed cells, bool; those whose clear space changed are set.
        beside: likewise squares with changes in their margin.

    Returns:
        The box of cells whose clearance changed, then that of the cells that are worse than before; the second number
        of a box is -1 when there are none.
    """
    height, width = cells.shape
    reach = len(clear_span) // 2
    top, bottom = max(changed[0] - reach, 0), min(changed[1] + reach, height - 1)
    left, right = max(changed[2] - reach, 0), min(changed[3] + reach, width - 1)
    # Columns to the nearest cell of the row that is not free, for all rows that count.
    first, last = max(top - reach, 0), min(bottom + reach, height - 1)
    near, far = max(left - reach, 0), min(right + reach, width - 1)
    gaps = np.empty((last - first + 1, far - near + 1), dtype=np.uint8)
    for row in range(first, last + 1):
        gap = _FAR
        for column in range(near, far + 1):
            gap = 0 if cells[row, column] != FREE else min(gap + 1, _FAR)
            gaps[row - first, column - near] = gap
        gap = _FAR
        for column in range(far, near - 1, -1):
            gap = min(gap + 1, _FAR) if gaps[row - first, column - near] else 0
            gaps[row - first, column - near] = min(gap, gaps[row - first, column - near])
    new = (height, -1, width, -1)
    lost = (height, -1, width, -1)
    count = right - left + 1
    not_tight = np.empty(count, dtype=np.bool_)
    not_clear = np.empty(count, dtype=np.bool_)
    for row in range(top, bottom + 1):
        not_tight[:] = False
        not_clear[:] = False
        for offset in range(-reach, reach + 1):
            if not first <= row + offset <= last:
                continue
            tight, wide = tight_span[offset + reach], clear_span[offset + reach]
            line = gaps[row + offset - first, left - near : right - near + 1]
            if wide >= 0:
                for k in range(count):
                    not_clear[k] |= line[k] <= wide
            if tight >= 0:
                for k in range(count):
                    not_tight[k] |= line[k] <= tight
        for k in range(count):
            value = BLOCKED if not_tight[k] else (TIGHT if not_clear[k] else CLEAR_CELL)
            column = left + k
            before = clear[row, column]
            if value != before:
                clear[row, column] = value
                mark(layout, row, column, dirty, beside)
                new = (min(new[0], row), row, min(new[2], column), max(new[3], column))
                if value > before:
                    lost = (min(lost[0], row), row, min(lost[2], column), max(lost[3], column))
    return (*new, *lost)


@njit(cache=True, nogil=True, inline="always")
def _point_gap(x: float, y: float, left: float, bottom: float) -> float:
    """Return the squared distance of a point from the cell whose lower left corner is given, cells."""
    dx = max(left - x, 0.0, x - left - 1.0)
    dy = max(bottom - y, 0.0, y - bottom - 1.0)
    return dx * dx + dy * dy


@njit(cache=True, nogil=True)
def _segment_gap(x0: float, y0: float, x1: float, y1: float, left: float, bottom: float) -> float:
    """Return the squared distance of a segment from a cell, cells."""
    gap = min(_point_gap(x0, y0, left, bottom), _point_gap(x1, y1, left, bottom))
    dx, dy = x1 - x0, y1 - y0
    length = dx * dx + dy * dy
    if gap == 0.0 or length == 0.0:
        return gap
    side = 0
    for corner in range(4):
        px, py = left + corner % 2 - x0, bottom + corner // 2 - y0
        cross = dx * py - dy * px
        side += 1 if cross > 0.0 else -1
        along = min(max((px * dx + py * dy) / length, 0.0), 1.0)
        ex, ey = px - along * dx, py - along * dy
        gap = min(gap, ex * ex + ey * ey)
    if abs(side) < 4:
        # The line parts the corners: the segment runs through the cell unless it ends before it.
        low_x, high_x, low_y, high_y = min(x0, x1), max(x0, x1), min(y0, y1), max(y0, y1)
        if high_x >= left and low_x <= left + 1.0 and high_y >= bottom and low_y <= bottom + 1.0:
            return 0.0
    return gap


@njit(cache=True, nogil=True)
def sweep(cells: NDArray[np.int8], width: int, x0: float, y0: float, x1: float, y1: float, most: float) -> float:
    """Return how much space there is around a segment: the distance to the nearest cell that is not free.

    Args:
        cells: padded grid of the belief, flat, int8.
        width: its cells per row.
        x0: start, cells from the lower left corner of the padded grid.
        y0: start.
        x1: end.
        y1: end.
        most: distances beyond do not matter and are not looked for.

    Returns:
        Cells, at most ``most``; 0 where the segment touches such a cell.
    """
    height = len(cells) // width
    best = most * most
    bottom = max(int(np.floor(min(y0, y1) - most)), 0)
    top = min(int(np.floor(max(y0, y1) + most)), height - 1)
    left = max(int(np.floor(min(x0, x1) - most)), 0)
    right = min(int(np.floor(max(x0, x1) + most)), width - 1)
    for row in range(bottom, top + 1):
        for column in range(left, right + 1):
            if cells[row * width + column] != FREE:
                best = min(best, _segment_gap(x0, y0, x1, y1, float(column), float(row)))
    return np.sqrt(best)


class Clearance:
    """Where a robot of some radius fits, for one generation of the belief.

    A free cell is TIGHT or better when its centre is at least the radius from every cell that is not free, unknown
    ones and the end of the grid included; it is CLEAR_CELL when all of its points are. So every straight segment
    through cells that are CLEAR_CELL keeps the radius, and so does every step between the centres of neighbouring
    cells that are TIGHT or better (a diagonal one needs both cells beside it): four such centres bound a square whose
    points are all at least as clear as one of its corners.

    Attributes:
        grid: CLEAR_CELL, TIGHT or BLOCKED (for radius 0 the belief itself, in which only free cells are passable),
            int8, shape of the padded grid.
    """

    def __init__(self, belief: CellGrid, radius: float) -> None:
        """Begin with nothing clear.

        Args:
            belief: its grid as it is allocated now.
            radius: of the robot, metres, 0 allowed.
        """
        self._point = radius <= 0.0
        cells = radius / belief.resolution
        self._tight, self._clear = near_spans(cells, 0.5), near_spans(cells, 1.0)
        self.grid = belief.padded if self._point else np.full(belief.padded.shape, BLOCKED, dtype=np.int8)

    def update(
        self,
        cells: NDArray[np.int8],
        changed: Box,
        lost: Box,
        layout: Layout,
        dirty: NDArray[np.bool_],
        beside: NDArray[np.bool_],
    ) -> tuple[Box, Box]:
        """Bring the grid up to date; arguments as `_update` describes them.

        Args:
            cells: padded grid of the belief, int8, shape (height, width).
            changed: box of all cells that changed.
            lost: box of those that are free no more; its second number is -1 when there are none.
            layout: of the squares.
            dirty: squares with changed cells; those whose clear space changed are set.
            beside: likewise squares with changes in their margin.

        Returns:
            The box of cells whose clearance changed, and that of those that are worse than before.
        """
        if self._point:
            return changed, lost
        boxes = _update(cells, self.grid, self._tight, self._clear, changed, layout, dirty, beside)
        return (boxes[0], boxes[1], boxes[2], boxes[3]), (boxes[4], boxes[5], boxes[6], boxes[7])

    def refresh(self, cells: NDArray[np.int8], changed: Box, lost: Box) -> tuple[Box, Box]:
        """Bring the grid up to date as `update` does, where nobody asks for squares."""
        nobody = np.zeros((2, 1, 1), dtype=np.bool_)
        return self.update(cells, changed, lost, undivided(*cells.shape), nobody[0], nobody[1])


def near_spans(radius: float, inside: float) -> NDArray[np.int16]:
    """Return, for each row offset, the farthest column offset of a cell that is nearer than a radius; -1 for none.

    Args:
        radius: cells.
        inside: how far points are from the centre of their own cell along an axis, and from that of the other, cells
            together: 0.5 measures from the centre of the cell, 1 from its nearest point.
    """
    reach = ceil(radius) + 1
    offsets = np.arange(-reach, reach + 1)
    gap: NDArray[np.float64] = np.maximum(np.abs(offsets) - inside, 0.0)
    near = np.hypot(gap[:, None], gap[None, :]) < radius - _TOLERANCE
    near[reach, reach] = True
    spans = np.where(near.any(axis=1), near[:, reach:].sum(axis=1) - 1, -1)
    return spans.astype(np.int16)
