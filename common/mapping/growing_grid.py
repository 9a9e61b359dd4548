"""A grid that is allocated where it is needed, and grows in any direction."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, NoReturn

from common.errors import MappingError
from common.mapping.sight import Box


class GrowingGrid(ABC):
    """Cells numbered from a fixed anchor; a rectangle of them is allocated. Not thread-safe.

    Subclasses hold the cells, and move them in `_move`. Cell (row, column) of the rectangle covers
    ``[origin + column * resolution, origin + (column + 1) * resolution)`` in x, likewise in y; row 0 is the bottom.

    Attributes:
        resolution: metres per cell.
        anchor: (x, y) of the lower left corner of the cell (0, 0) of the numbering, metres.
    """

    block: ClassVar[int] = 1
    """Cells are allocated in blocks of this many, so that few of the robot's steps make the grid grow."""
    max_cells: ClassVar[int]

    def __init__(self, resolution: float, anchor: tuple[float, float]) -> None:
        """Allocate nothing yet."""
        self.resolution = resolution
        self.anchor = anchor
        self._first = (0, 0)
        self._shape = (0, 0)
        self._changed: Box | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns that are allocated."""
        return self._shape

    @property
    def first_cell(self) -> tuple[int, int]:
        """Number (row, column) of the first allocated cell; it may be negative."""
        return self._first

    @property
    def origin(self) -> tuple[float, float]:
        """(x, y) of the lower left corner of what is allocated, metres."""
        row, column = self._first
        return self.anchor[0] + column * self.resolution, self.anchor[1] + row * self.resolution

    def cover(self, row_low: int, row_high: int, column_low: int, column_high: int) -> None:
        """Allocate a half-open rectangle of cell numbers, besides what is allocated already.

        Raises:
            MappingError: it would take too many cells.
        """
        (rows, columns), (row, column) = self._shape, self._first
        allocated = rows > 0 and columns > 0
        if allocated and (
            row <= row_low and row_high <= row + rows and column <= column_low and column_high <= column + columns
        ):
            return
        low = (self._down(row_low), self._down(column_low))
        high = (-self._down(-row_high), -self._down(-column_high))
        if allocated:
            low = (min(low[0], row), min(low[1], column))
            high = (max(high[0], row + rows), max(high[1], column + columns))
        shape = (high[0] - low[0], high[1] - low[1])
        if shape[0] * shape[1] > self.max_cells:
            self._refuse(*shape)
        down, right = row - low[0], column - low[1]
        if self._changed is not None:
            top, bottom, left, end = self._changed
            self._changed = (top + down, bottom + down, left + right, end + right)
        before = (down, down + rows, right, right + columns) if allocated else None
        self._first, self._shape = low, shape
        self._move(before)

    def note(self, box: Box) -> None:
        """Remember that the cells of a box (first row, last row, first column, last column) changed."""
        old = self._changed
        if old is not None:
            box = (min(old[0], box[0]), max(old[1], box[1]), min(old[2], box[2]), max(old[3], box[3]))
        self._changed = box

    def take_changes(self) -> Box | None:
        """Return the box that holds all changes since the last call, or None."""
        changed, self._changed = self._changed, None
        return changed

    @abstractmethod
    def _move(self, before: tuple[int, int, int, int] | None) -> None:
        """Allocate arrays of the new shape and copy the old ones into them.

        Args:
            before: rows (from, to) and columns (from, to) at which the old cells lie in the new arrays; None without
                old ones.
        """

    def _refuse(self, rows: float, columns: float) -> NoReturn:
        raise MappingError(
            f"the map would need {rows:.0f} x {columns:.0f} cells of {self.resolution} m, more than {self.max_cells}: "
            "check the robot's pose and its map, or use coarser cells (mapping.resolution)"
        )

    def _down(self, number: int) -> int:
        return number // self.block * self.block
