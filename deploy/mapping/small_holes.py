"""Holes: unknown areas that known cells enclose and that are too small to be worth a look.

The inside of a desk leg, the shadow in a corner, a few cells that every beam grazes: a robot that goes for them drives
as far again as for all the rest of a building. What lies behind a door is no hole, however narrow the door, because
it is open to all that is unknown outside.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.mapping.belief import Belief
from common.mapping.sight import FREE, OCCUPIED, UNKNOWN, Box
from common.system.jit import njit

# Marks of cells: not flooded yet; flooded; and known to lie in an area that is no hole.
_UNSEEN: Final = 0
_SEEN: Final = 1
_OPEN: Final = 2


class SmallHoles:
    """The holes of one belief, which planners are shown as obstacles.

    In a map made of scans a hole stays one: what is unknown does not grow. Cells of it that a scan tells of are shown
    as they are.
    """

    def __init__(self, area: float, resolution: float) -> None:
        """Know of none; `area` of the largest hole, square metres, 0 for none at all; `resolution` in metres."""
        self._limit = int(area / resolution**2)
        self.forget()

    def forget(self) -> None:
        """Forget all holes, because the grid is another one."""
        # Row and column of each cell, counted from the anchor, because grids grow in all directions.
        self._cells = np.empty((0, 2), dtype=np.int64)

    def close(self, cells: NDArray[np.int8], first: tuple[int, int]) -> None:
        """Mark the unknown cells of known holes as occupied, in place.

        Args:
            cells: part of a grid, int8, shape (rows, columns).
            first: row and column of its first cell, counted from the anchor.
        """
        rows, columns = (self._cells - first).T
        inside = (rows >= 0) & (rows < cells.shape[0]) & (columns >= 0) & (columns < cells.shape[1])
        rows, columns = rows[inside], columns[inside]
        unknown = cells[rows, columns] == UNKNOWN
        cells[rows[unknown], columns[unknown]] = OCCUPIED

    def find(self, belief: Belief, box: Box) -> NDArray[np.int64]:
        """Take in the new holes that touch a part of a belief.

        Args:
            belief: where known holes are closed already.
            box: first and last row, first and last column of its grid.

        Returns:
            Row and column in the belief's grid of the cells of new holes, shape (n, 2).
        """
        if not self._limit:
            return np.empty((0, 2), dtype=np.int64)
        found = _find(belief.padded, box[0] + 1, box[1] + 1, box[2] + 1, box[3] + 1, self._limit)
        rows, columns = np.divmod(found, belief.padded.shape[1])
        cells = np.stack([rows - 1, columns - 1], axis=1)
        self._cells = np.concatenate([self._cells, cells + belief.first_cell])
        return cells


@njit(cache=True, nogil=True)
def _find(padded: NDArray[np.int8], top: int, bottom: int, left: int, right: int, limit: int) -> NDArray[np.int64]:
    """Flood from every unknown cell of the box that borders on a free one, over eight neighbours, up to the limit."""
    width = padded.shape[1]
    cells = padded.reshape(-1)
    marks = np.zeros(len(cells), dtype=np.int8)
    area = np.empty(limit + 9, dtype=np.int64)
    holes = [np.int64(0) for _ in range(0)]
    for row in range(top, bottom + 1):
        for start in range(row * width + left, row * width + right + 1):
            if cells[start] != UNKNOWN or marks[start] != _UNSEEN:
                continue
            if FREE not in (cells[start - 1], cells[start + 1], cells[start - width], cells[start + width]):
                continue
            area[0] = start
            marks[start] = _SEEN
            size, at, enclosed = 1, 0, True
            while at < size and enclosed:
                here = area[at]
                at += 1
                for step in (-width - 1, -width, -width + 1, -1, 1, width - 1, width, width + 1):
                    there = here + step
                    if cells[there] < UNKNOWN or (cells[there] == UNKNOWN and marks[there] == _OPEN):
                        enclosed = False
                    elif cells[there] == UNKNOWN and marks[there] == _UNSEEN:
                        marks[there] = _SEEN
                        area[size] = there
                        size += 1
                if size > limit:
                    enclosed = False
            for cell in area[:size]:
                if enclosed:
                    holes.append(cell)
                else:
                    marks[cell] = _OPEN
    return np.array(holes, dtype=np.int64)
