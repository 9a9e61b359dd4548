"""Frontiers: free cells at the edge of what is known, kept up to date where the belief changed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.mapping.belief import Belief
from common.mapping.clearance import near_spans
from common.mapping.passages import any_near, count_wall, update_passages
from common.mapping.sight import FREE, OCCUPIED, UNKNOWN, Box
from common.mapping.squares import Layout, mark
from common.system.copies import copy_values
from common.system.jit import njit

# Unknown cells among its eight neighbours that make a free cell a frontier.
MIN_UNKNOWN: Final = 2


@njit(cache=True, nogil=True)
def _find_changes(
    cells: NDArray[np.int8],
    settled: NDArray[np.int8],
    mask: NDArray[np.bool_],
    passages: NDArray[np.bool_],
    crowd: NDArray[np.int32],
    spans: NDArray[np.int16],
    row_low: int,
    row_high: int,
    column_low: int,
    column_high: int,
    added: NDArray[np.int32],
    removed: NDArray[np.int32],
    layout: Layout,
    dirty: NDArray[np.bool_],
    beside: NDArray[np.bool_],
) -> tuple[int, int, int, int, int, int]:
    """Find the frontiers that came and went, and the cells that are free no more.

    A frontier is a free cell with at least `MIN_UNKNOWN` unknown cells among its eight neighbours, those outside the
    grid included, and with a passage nearer than the robot's radius, where it has one.

    Args:
        cells: padded grid, int8, shape (height, width).
        settled: the padded grid at the last update, same shape; brought up to date.
        mask: cells that are frontiers, bool, shape (height, width); brought up to date.
        passages: see `update_passages`, same shape; brought up to date. Without cells for a robot without a radius.
        crowd: see `count_wall`, likewise.
        spans: the robot's disc, see `near_spans`.
        row_low: first row of the box of changes in the padded grid.
        row_high: its last row.
        column_low: its first column.
        column_high: its last column.
        added: receives flat indices of new frontiers, int32; as long as the grid.
        removed: receives flat indices of cells that are frontiers no more, likewise.
        layout: of the lattice squares.
        dirty: squares, bool; those with a cell that changed are set.
        beside: likewise those with such a cell in their margin.

    Returns:
        Number of new and of gone frontiers, and the box (first row, last row, first column, last column) of cells
        that were free and are not any more; its last row is -1 when there are none.
    """
    height, width = cells.shape
    lost = (height, -1, width, -1)
    for row in range(row_low, row_high + 1):
        marked = -1
        for column in range(column_low, column_high + 1):
            if settled[row, column] != cells[row, column]:
                if settled[row, column] == FREE:
                    lost = (min(lost[0], row), row, min(lost[2], column), max(lost[3], column))
                if len(crowd) and OCCUPIED in (settled[row, column], cells[row, column]):
                    count_wall(crowd, row, column, spans, 1 if cells[row, column] == OCCUPIED else -1)
                settled[row, column] = cells[row, column]
                # The margins of two cells of a run hold those of all between.
                if marked < 0 or layout.column_of[column] != layout.column_of[marked]:
                    if marked >= 0:
                        mark(layout, row, marked, dirty, beside)
                    mark(layout, row, column, dirty, beside)
                marked = column
        if marked >= 0:
            mark(layout, row, marked, dirty, beside)
    box = (row_low, row_high, column_low, column_high)
    margin = 1
    if len(passages):
        margin = len(spans) // 2
        box = update_passages(cells, passages, crowd, margin, box)
    first, last = max(box[2] - margin, 1), min(box[3] + margin, width - 2)
    new = 0
    gone = 0
    for row in range(max(box[0] - margin, 1), min(box[1] + margin, height - 2) + 1):
        below, here, above = cells[row - 1], cells[row], cells[row + 1]
        left = (below[first - 1] < 0) + (here[first - 1] < 0) + (above[first - 1] < 0)
        middle = (below[first] < 0) + (here[first] < 0) + (above[first] < 0)
        for column in range(first, last + 1):
            right = (below[column + 1] < 0) + (here[column + 1] < 0) + (above[column + 1] < 0)
            frontier = here[column] == FREE and left + middle + right >= MIN_UNKNOWN
            if frontier and len(passages):
                frontier = any_near(passages, row, column, spans)
            if frontier != mask[row, column]:
                mask[row, column] = frontier
                if frontier:
                    added[new] = row * width + column
                    new += 1
                else:
                    removed[gone] = row * width + column
                    gone += 1
            left, middle = middle, right
    return new, gone, lost[0], lost[1], lost[2], lost[3]


@njit(cache=True, nogil=True)
def _merge(flat: NDArray[np.int64], added: NDArray[np.int32], removed: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return ascending numbers with some more, and without some others; all of them ascending."""
    merged = np.empty(len(flat) + len(added) - len(removed), dtype=np.int64)
    size, a, r = 0, 0, 0
    for cell in flat:
        while a < len(added) and added[a] < cell:
            merged[size] = added[a]
            size += 1
            a += 1
        if r < len(removed) and removed[r] == cell:
            r += 1
        else:
            merged[size] = cell
            size += 1
    copy_values(merged[size:], added[a:])
    return merged


@njit(cache=True, nogil=True)
def middles(flat: NDArray[np.int64], width: int, resolution: float, x: float, y: float) -> NDArray[np.float64]:
    """Return the middles of cells of a padded grid whose inner lower left corner lies at (x, y), metres, (m, 2)."""
    places = np.empty((len(flat), 2))
    for k in range(len(flat)):
        row = flat[k] // width
        places[k, 0] = (flat[k] - row * width - 0.5) * resolution + x
        places[k, 1] = (row - 0.5) * resolution + y
    return places


@dataclass(frozen=True, slots=True, eq=False)
class FrontierChanges:
    """What an update did to the frontiers.

    Attributes:
        added: flat cells of the padded grid that became frontiers, int32; valid until the next update.
        removed: flat cells that are frontiers no more, likewise.
        lost: box of the cells that were free and are not any more; its second number is -1 when there are none.
    """

    added: NDArray[np.int32]
    removed: NDArray[np.int32]
    lost: Box


class Frontiers:
    """The frontiers of one generation of the belief.

    A frontier is a free cell with at least two unknown cells among its eight neighbours: a single unknown cell, as
    it stays behind when two walls meet in a corner that no beam ever enters, is nothing to explore. For a robot with a
    radius there must be a passage nearer than that (`common.mapping.passages`): whatever it can get to and has not
    seen lies behind one, while holes that beams leave in walls, and slivers behind posts, are nothing to go for.
    """

    def __init__(self, belief: Belief, radius: float = 0.0) -> None:
        """Begin with none.

        Args:
            belief: its grid as it is allocated now.
            radius: of the robot, metres, 0 allowed.
        """
        padded = belief.padded
        looked_at = padded.shape if radius > 0.0 else (0, 0)
        self._passages = np.zeros(looked_at, dtype=np.bool_)
        self._crowd = np.zeros(looked_at, dtype=np.int32)
        self._spans = near_spans(radius / belief.resolution, 0.5)
        self._settled = np.full(padded.shape, UNKNOWN, dtype=np.int8)
        self._mask = np.zeros(padded.shape, dtype=np.bool_)
        self._added = np.empty(padded.size, dtype=np.int32)
        self._removed = np.empty(padded.size, dtype=np.int32)
        self._flat: NDArray[np.int64] | None = None

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Frontier cells of the belief's grid (not padded), bool, shape (rows, columns)."""
        return self._mask[1:-1, 1:-1]

    @property
    def padded_mask(self) -> NDArray[np.bool_]:
        """Frontier cells of the padded grid, bool."""
        return self._mask

    @property
    def flat(self) -> NDArray[np.int64]:
        """Flat indices of the frontier cells in the padded grid, ascending; found once, then kept up to date."""
        if self._flat is None:
            self._flat = np.flatnonzero(self._mask)
        return self._flat

    def update(
        self,
        padded: NDArray[np.int8],
        changed: Box,
        layout: Layout,
        dirty: NDArray[np.bool_],
        beside: NDArray[np.bool_],
    ) -> FrontierChanges:
        """Bring the frontiers up to date.

        Args:
            padded: the belief's padded grid.
            changed: box of all cells that changed since the last update.
            layout: of the lattice squares.
            dirty: squares, bool, shape (rows, columns); those with a cell that changed are set.
            beside: likewise those with such a cell in their margin.
        """
        added, removed, *lost = _find_changes(
            padded, self._settled, self._mask, self._passages, self._crowd, self._spans, *changed,
            self._added, self._removed, layout, dirty, beside,
        )  # fmt: skip
        changes = FrontierChanges(self._added[:added], self._removed[:removed], (lost[0], lost[1], lost[2], lost[3]))
        if self._flat is not None and (added or removed):
            self._flat = _merge(self._flat, changes.added, changes.removed)
        return changes
