"""Whether the robot's SLAM began a new map.

A SLAM that is started anew begins where the robot stands then, or where its odometry has it: the frame `map` lies
elsewhere from then on, and home and targets with it. Its map is taken like any other, but nothing says that it is a new
one. A new map is smaller, shows other things in the same places, and the pose leapt or fell silent. Where a loop is
closed the pose leaps as well, and the map moves, but stays about as large; one that begins anew in the same frame fits.
"""

from __future__ import annotations

import logging
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.mapping.sight import UNKNOWN
from common.system.logs import lasting
from deploy.mapping.measured_grid import MeasuredGrid

log = logging.getLogger(__name__)

# A map is another one where it knows less than the first share of what the last one knew, and no more than the second
# share of what it knows was the same there.
_SMALLER: Final = 0.8
_OTHER: Final = 0.5
# The old map is back where so large a share of what it knew is there again.
_BACK: Final = 0.6
# The leap may be told this many maps later than the map that shrank.
_MAPS_AHEAD: Final = 2


class NewMapWatch:
    """Compares every map of a SLAM with the one before; not thread-safe.

    Attributes:
        problem: why home and targets are not where the map has them, for the operator; empty while they are.

    Usage::

        watch.leapt("the pose jumped 7.30 m")
        watch.take(cells, new, row, column)  # before the new map takes the place of the cells
    """

    def __init__(self) -> None:
        """Know no map yet."""
        self.problem = ""
        self._why = ""
        self._shrank = ""
        self._old: tuple[NDArray[np.int8], int, int] | None = None
        self._maps = 0

    def leapt(self, why: str) -> None:
        """Hear that the pose does not continue the one before, in words as of `PoseLeaps`."""
        self._why = why
        self._judge()

    def take(self, before: MeasuredGrid, cells: NDArray[np.int8], row: int, column: int) -> None:
        """Take in the next map.

        Args:
            before: the last one; empty before the first.
            cells: -1, 0 or 100, int8, shape (rows, columns).
            row: number of its first row, in the numbering of ``before``.
            column: number of its first column.
        """
        if self._old is not None:
            old = self._old[0]
            if _same(*self._old, cells, row, column) >= _BACK * np.count_nonzero(old != UNKNOWN):
                self.problem, self._old = "", None
            elif not self.problem:
                self._maps += 1
                self._old = self._old if self._maps <= _MAPS_AHEAD else None
            if self._old is not None:
                return
        known, is_known = np.count_nonzero(before.states != UNKNOWN), np.count_nonzero(cells != UNKNOWN)
        if (
            is_known >= _SMALLER * known
            or _same(before.states, *before.first_cell, cells, row, column) > _OTHER * is_known
        ):
            self._why = ""
            return
        area = before.resolution**2
        self._shrank = f"from {known * area:.0f} to {is_known * area:.0f} m²"
        self._old, self._maps = (before.states.copy(), *before.first_cell), 0
        self._judge()

    def _judge(self) -> None:
        if self._old is None or not self._why or self.problem:
            return
        self.problem = (
            f"{self._why}, and the SLAM's map shrank {self._shrank}: it began a new map, in which home and targets lie "
            "elsewhere. Let it load the old one, or send `reset` to go on with the new one; home is forgotten then"
        )
        log.warning("%s", self.problem, extra=lasting(lambda: bool(self.problem)))


def _same(old: NDArray[np.int8], old_row: int, old_column: int, new: NDArray[np.int8], row: int, column: int) -> int:
    """Return the number of cells that two maps agree on; each has the numbers of its first row and column."""
    top, left = max(old_row, row), max(old_column, column)
    bottom = min(old_row + old.shape[0], row + new.shape[0])
    right = min(old_column + old.shape[1], column + new.shape[1])
    if bottom <= top or right <= left:
        return 0
    part = old[top - old_row : bottom - old_row, left - old_column : right - old_column]
    other = new[top - row : bottom - row, left - column : right - column]
    return int(np.count_nonzero((part == other) & (part != UNKNOWN)))
