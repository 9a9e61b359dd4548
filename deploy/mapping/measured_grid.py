"""The robot's grid as it was measured: unknown, free or occupied, growing in any direction."""

from __future__ import annotations

from math import floor
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.mapping.growing_grid import GrowingGrid
from common.mapping.sight import FREE, OCCUPIED, UNKNOWN

MAX_CELLS: Final = 1 << 26


class MeasuredGrid(GrowingGrid):
    """Cells of -1, 0 and 100; boxes of changes are those of ``states``.

    Attributes:
        states: int8, shape (rows, columns), row 0 at the bottom; replaced when the grid grows.
    """

    block = 32
    max_cells = MAX_CELLS

    def __init__(self, resolution: float, anchor: tuple[float, float]) -> None:
        super().__init__(resolution, anchor)
        self.states: NDArray[np.int8] = np.empty((0, 0), dtype=np.int8)

    @property
    def empty(self) -> bool:
        """Whether nothing received yet."""
        return self.states.size == 0

    @property
    def free_area(self) -> float:
        """Free area, square metres."""
        return float(np.count_nonzero(self.states == FREE)) * self.resolution**2

    def number(self, position: tuple[float, float]) -> tuple[int, int]:
        """Return the number (row, column) of the cell that holds a position."""
        return (
            floor((position[1] - self.anchor[1]) / self.resolution),
            floor((position[0] - self.anchor[0]) / self.resolution),
        )

    def replace(self, cells: NDArray[np.int8], row: int, column: int) -> None:
        """Take a whole map: its cells, and unknown everywhere else.

        Args:
            cells: -1, 0 or 100, int8, shape (rows, columns).
            row: number of its first row.
            column: number of its first column.
        """
        self.cover(row, row + cells.shape[0], column, column + cells.shape[1])
        states = np.full_like(self.states, UNKNOWN)
        top, left = row - self._first[0], column - self._first[1]
        states[top : top + cells.shape[0], left : left + cells.shape[1]] = cells
        changed = states != self.states
        rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
        if len(rows):
            self.states = states
            self.note((int(rows[0]), int(rows[-1]), int(columns[0]), int(columns[-1])))

    def write(self, cells: NDArray[np.int8], row: int, column: int) -> None:
        """Take a part of the map: its cells, and nothing else changes; arguments as for `replace`."""
        self.cover(row, row + cells.shape[0], column, column + cells.shape[1])
        top, left = row - self._first[0], column - self._first[1]
        part = self.states[top : top + cells.shape[0], left : left + cells.shape[1]]
        changed = part != cells
        rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
        if len(rows):
            part[:] = cells
            self.note((top + int(rows[0]), top + int(rows[-1]), left + int(columns[0]), left + int(columns[-1])))

    def occupied_near(self, position: tuple[float, float], radius: float) -> NDArray[np.float64]:
        """Return the centres of occupied cells within a radius, metres, shape (n, 2)."""
        reach = int(radius / self.resolution) + 2
        row, column = self.number(position)
        row, column = row - self._first[0], column - self._first[1]
        top, left = max(row - reach, 0), max(column - reach, 0)
        part = self.states[top : max(row + reach + 1, 0), left : max(column + reach + 1, 0)]
        rows, columns = np.nonzero(part == OCCUPIED)
        centres = np.stack([columns + left + 0.5, rows + top + 0.5], axis=1) * self.resolution + np.array(self.origin)
        return centres[np.hypot(centres[:, 0] - position[0], centres[:, 1] - position[1]) <= radius]

    def _move(self, before: tuple[int, int, int, int] | None) -> None:
        states = np.full(self._shape, UNKNOWN, dtype=np.int8)
        if before is not None:
            top, bottom, left, right = before
            states[top:bottom, left:right] = self.states
        self.states = states
