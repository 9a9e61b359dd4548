"""The robot's grid as it was measured: unknown, free or occupied, growing in any direction."""

from __future__ import annotations

from math import floor
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.errors import MappingError
from common.mapping.sight import FREE, OCCUPIED, UNKNOWN, Box

# Cells are allocated in blocks of this many, so that a robot that drives on does not make the grid grow at every scan.
BLOCK: Final = 32
MAX_CELLS: Final = 1 << 26


class CellGrid:
    """Cells of -1, 0 and 100, numbered from a fixed anchor; not thread-safe.

    Attributes:
        resolution: metres per cell.
        anchor: (x, y) of the lower left corner of the cell (0, 0) of the numbering, metres.
        states: int8, shape (rows, columns), row 0 at the bottom; replaced when the grid grows.
        first: number (row, column) of the cell ``states[0, 0]``; it may be negative.
    """

    def __init__(self, resolution: float, anchor: tuple[float, float]) -> None:
        self.resolution = resolution
        self.anchor = anchor
        self.states: NDArray[np.int8] = np.empty((0, 0), dtype=np.int8)
        self.first = (0, 0)
        self._dirty: Box | None = None

    @property
    def origin(self) -> tuple[float, float]:
        """(x, y) of the lower left corner of ``states``, metres."""
        row, column = self.first
        return self.anchor[0] + column * self.resolution, self.anchor[1] + row * self.resolution

    @property
    def empty(self) -> bool:
        """Whether nothing has come yet."""
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

    def cover(self, row_low: int, row_high: int, column_low: int, column_high: int) -> None:
        """Allocate a half-open rectangle of cell numbers, besides what is allocated already.

        Raises:
            MappingError: it would take too many cells.
        """
        rows, columns = self.states.shape
        row, column = self.first
        if rows and (
            row <= row_low and row_high <= row + rows and column <= column_low and column_high <= column + columns
        ):
            return
        low = (_down(row_low), _down(column_low))
        high = (-_down(-row_high), -_down(-column_high))
        if rows:
            low = (min(low[0], row), min(low[1], column))
            high = (max(high[0], row + rows), max(high[1], column + columns))
        shape = (high[0] - low[0], high[1] - low[1])
        if shape[0] * shape[1] > MAX_CELLS:
            raise MappingError(
                f"the map would need {shape[0]} x {shape[1]} cells of {self.resolution} m, more than {MAX_CELLS}: "
                "check the robot's pose and its map, or use coarser cells (mapping.resolution)"
            )
        self._move(low, shape)

    def replace(self, cells: NDArray[np.int8], row: int, column: int) -> None:
        """Take a whole map: its cells, and unknown everywhere else.

        Args:
            cells: -1, 0 or 100, int8, shape (rows, columns).
            row: number of its first row.
            column: number of its first column.
        """
        self.cover(row, row + cells.shape[0], column, column + cells.shape[1])
        states = np.full_like(self.states, UNKNOWN)
        top, left = row - self.first[0], column - self.first[1]
        states[top : top + cells.shape[0], left : left + cells.shape[1]] = cells
        changed = states != self.states
        rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
        if len(rows):
            self.states = states
            self.note((int(rows[0]), int(rows[-1]), int(columns[0]), int(columns[-1])))

    def write(self, cells: NDArray[np.int8], row: int, column: int) -> None:
        """Take a part of the map: its cells, and nothing else changes; arguments as for `replace`."""
        self.cover(row, row + cells.shape[0], column, column + cells.shape[1])
        top, left = row - self.first[0], column - self.first[1]
        part = self.states[top : top + cells.shape[0], left : left + cells.shape[1]]
        changed = part != cells
        rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
        if len(rows):
            part[:] = cells
            self.note((top + int(rows[0]), top + int(rows[-1]), left + int(columns[0]), left + int(columns[-1])))

    def note(self, box: Box) -> None:
        """Remember that cells of a box (first row, last row, first column, last column of ``states``) changed."""
        old = self._dirty
        if old is not None:
            box = (min(old[0], box[0]), max(old[1], box[1]), min(old[2], box[2]), max(old[3], box[3]))
        self._dirty = box

    def take_changes(self) -> Box | None:
        """Return the box of ``states`` that holds all changes since the last call, or None."""
        dirty, self._dirty = self._dirty, None
        return dirty

    def occupied_near(self, position: tuple[float, float], radius: float) -> NDArray[np.float64]:
        """Return the centres of occupied cells within a radius, metres, shape (n, 2)."""
        reach = int(radius / self.resolution) + 2
        row, column = self.number(position)
        row, column = row - self.first[0], column - self.first[1]
        top, left = max(row - reach, 0), max(column - reach, 0)
        part = self.states[top : max(row + reach + 1, 0), left : max(column + reach + 1, 0)]
        rows, columns = np.nonzero(part == OCCUPIED)
        centres = np.stack([columns + left + 0.5, rows + top + 0.5], axis=1) * self.resolution + np.array(self.origin)
        return centres[np.hypot(centres[:, 0] - position[0], centres[:, 1] - position[1]) <= radius]

    def _move(self, low: tuple[int, int], shape: tuple[int, int]) -> None:
        """Allocate anew; the noted box moves along."""
        rows, columns = self.states.shape
        down, right = self.first[0] - low[0], self.first[1] - low[1]
        states = np.full(shape, UNKNOWN, dtype=np.int8)
        if rows:
            states[down : down + rows, right : right + columns] = self.states
        if self._dirty is not None:
            top, bottom, left, end = self._dirty
            self._dirty = (top + down, bottom + down, left + right, end + right)
        self.states, self.first = states, low


def _down(number: int) -> int:
    return number // BLOCK * BLOCK
