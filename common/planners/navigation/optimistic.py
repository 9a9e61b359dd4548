"""The optimistic world: everything that the belief does not rule out, with unknown space taken as free."""

from __future__ import annotations

from math import ceil
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.mapping.belief import Belief
from common.mapping.raycast import SUBCELL_BITS
from common.mapping.sight import FREE, NOTHING_LOST, OCCUPIED, OUTSIDE, Box
from common.planners.base import Position
from common.system.jit import njit

# The world continues this many spacings beyond the belief, the robot and the target: ways around what is known, through
# what is not, are part of the world at its best.
MARGIN: Final = 3
# Whether a cell is in doubt: not at all, until it is known to be free, or whatever is known.
_UNTIL_FREE: Final = 1
_ALWAYS: Final = 2
_NO_CELLS: Final = np.empty(0, dtype=np.int32)


@njit(cache=True, nogil=True, inline="always")
def _taken(value: int, doubt: int) -> bool:
    """Whether a cell counts as occupied."""
    return (value == OCCUPIED) | (doubt == _ALWAYS) | ((doubt == _UNTIL_FREE) & (value != FREE))


@njit(cache=True, nogil=True)
def _copy(
    known: NDArray[np.int8],
    down: int,
    right: int,
    doubt: NDArray[np.int8],
    cells: NDArray[np.int8],
    changed: NDArray[np.int32],
) -> int:
    """Take over what the belief says; return how many cells differ from before.

    Args:
        known: cells of the belief without their ring.
        down: rows of ``cells`` below the first one of the belief.
        right: columns of ``cells`` before the first one of the belief.
        doubt: whether a cell is in doubt, int8, shape of ``cells``.
        cells: FREE or OCCUPIED, int8; brought up to date.
        changed: receives the flat numbers of the cells that differ, int32, as long as ``cells``.
    """
    rows, columns = known.shape
    width = cells.shape[1]
    count = 0
    for r in range(rows):
        source = known[r]
        doubts = doubt[r + down, right : right + columns]
        here = cells[r + down, right : right + columns]
        different = False
        for c in range(columns):
            different |= _taken(source[c], doubts[c]) != (here[c] == OCCUPIED)
        if not different:
            continue
        for c in range(columns):
            taken = _taken(source[c], doubts[c])
            if taken != (here[c] == OCCUPIED):
                here[c] = OCCUPIED if taken else FREE
                changed[count] = (r + down) * width + right + c
                count += 1
    return count


class OptimisticBelief:
    """A grid that reaches beyond the belief: occupied where that says so, free everywhere else.

    It is what `ViewpointGraph` and `Clearance` can read like a belief. Its cells are those of the belief: a cell keeps
    its number from the belief's anchor.

    Attributes:
        generation: rises whenever the grid is allocated anew, so that cells and subcells of before are void.
        changed: flat numbers of the cells of the padded grid that the last update changed, int32; of a new grid those
            that are occupied.
        box: box of all cells that the last update changed, all of a new grid; None for none.
        lost: box of those that are free no more; its second number is -1 when there are none.
    """

    def __init__(self, margin: float) -> None:
        """Cover nothing yet; `margin`, metres, is how far the grid reaches beyond what it must hold."""
        self._margin = margin
        self._must: Box | None = None
        self._first = (0, 0)
        self._padded = np.full((2, 2), OUTSIDE, dtype=np.int8)
        self._doubts: dict[tuple[int, int], int] = {}
        self._doubt = np.zeros((2, 2), dtype=np.int8)
        self.generation = 0
        self.changed = _NO_CELLS
        self.box: Box | None = None
        self.lost: Box = NOTHING_LOST

    @property
    def padded(self) -> NDArray[np.int8]:
        """The grid with its ring of OUTSIDE cells."""
        return self._padded

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns, without the ring."""
        return self._padded.shape[0] - 2, self._padded.shape[1] - 2

    @property
    def resolution(self) -> float:
        """Metres per cell."""
        return self._belief.resolution

    @property
    def first_cell(self) -> tuple[int, int]:
        """(row, column) of cell (0, 0), counted from the belief's anchor."""
        return self._first

    @property
    def origin(self) -> Position:
        """(x, y) of the lower left corner of cell (0, 0), metres."""
        belief = self._belief
        down, right = self._offset()
        return belief.origin[0] - right * belief.resolution, belief.origin[1] - down * belief.resolution

    def subcells(self, position: Position) -> tuple[int, int]:
        """Return a position in subcells from the lower left corner of the padded grid."""
        x, y = self._belief.subcells(position)
        down, right = self._offset()
        return x + (right << SUBCELL_BITS), y + (down << SUBCELL_BITS)

    def cell(self, position: Position) -> tuple[int, int]:
        """Return the (row, column) of the padded grid that holds a position."""
        x, y = self.subcells(position)
        return y >> SUBCELL_BITS, x >> SUBCELL_BITS

    def update(self, belief: Belief, *places: Position) -> None:
        """Take over what the belief says now, on a grid that holds all of its cells and the places, metres."""
        self._belief = belief
        fresh = self._fit(belief, places)
        rows, columns = belief.shape
        down, right = self._offset()
        changed = np.empty(self._padded.size, dtype=np.int32)
        count = _copy(belief.padded[1:-1, 1:-1], down + 1, right + 1, self._doubt, self._padded, changed)
        beyond = [
            (row, column)
            for row, column in self._marked()
            if not (down < row <= down + rows and right < column <= right + columns)
            and self._padded[row, column] == FREE
        ]
        for row, column in beyond:
            self._padded[row, column] = OCCUPIED
            changed[count] = row * self._padded.shape[1] + column
            count += 1
        self.changed = changed[:count].copy()
        self.box = _box(self.changed, self._padded.shape[1]) if count else None
        self.lost = NOTHING_LOST
        if count:
            occupied = self.changed[self._padded.reshape(-1)[self.changed] == OCCUPIED]
            self.lost = _box(occupied, self._padded.shape[1]) if len(occupied) else NOTHING_LOST
        if fresh:
            self.box = (1, self._padded.shape[0] - 2, 1, self._padded.shape[1] - 2)

    def doubt(self, position: Position, *, always: bool = False) -> None:
        """Take the cell at a position for an obstacle from the next update on, until it is known to be free.

        For cells that a scan from nearby left unknown: the robot may not drive there, so hoping is no use. With
        `always`, for cells that the robot cannot get to, whatever the belief says.
        """
        row, column = self.cell(position)
        kind = _ALWAYS if always else _UNTIL_FREE
        # Counted from the anchor, so that they outlive a growth.
        cell = (row - 1 + self._first[0], column - 1 + self._first[1])
        self._doubts[cell] = max(kind, self._doubts.get(cell, kind))
        self._doubt[row, column] = self._doubts[cell]

    def _marked(self) -> list[tuple[int, int]]:
        """Return the cells in doubt, (row, column) of the padded grid."""
        return [(row + 1 - self._first[0], column + 1 - self._first[1]) for row, column in self._doubts]

    def _offset(self) -> tuple[int, int]:
        """Return how many rows and columns there are before those of the belief."""
        first = self._belief.first_cell
        return first[0] - self._first[0], first[1] - self._first[1]

    def _fit(self, belief: Belief, places: tuple[Position, ...]) -> bool:
        """Reallocate the grid when it does not cover everything that it must; return whether it did."""
        row, column = belief.first_cell
        cells = [(row + r, column + c) for r, c in map(belief.cell, places)]
        rows = [row, row + belief.shape[0], *(r for r, _ in cells), *(r + 1 for r, _ in cells)]
        columns = [column, column + belief.shape[1], *(c for _, c in cells), *(c + 1 for _, c in cells)]
        must = (min(rows), max(rows), min(columns), max(columns))
        if self._must is not None:
            old = self._must
            must = (min(must[0], old[0]), max(must[1], old[1]), min(must[2], old[2]), max(must[3], old[3]))
            if must == old:
                return False
        self._must = must
        around = ceil(self._margin / belief.resolution)
        self._first = (must[0] - around, must[2] - around)
        self._padded = np.full(
            (must[1] - must[0] + 2 * around + 2, must[3] - must[2] + 2 * around + 2), OUTSIDE, dtype=np.int8
        )
        self._padded[1:-1, 1:-1] = FREE
        self._doubt = np.zeros(self._padded.shape, dtype=np.int8)
        for (r, c), kind in zip(self._marked(), self._doubts.values(), strict=True):
            self._doubt[r, c] = kind
        self.generation += 1
        return True


def _box(cells: NDArray[np.int32], width: int) -> Box:
    """Return the box around cells, at least one."""
    rows, columns = np.divmod(cells, width)
    return int(rows.min()), int(rows.max()), int(columns.min()), int(columns.max())
