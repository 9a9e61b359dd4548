"""Ground truth of one world: only simulators, privileged experts and evaluation may look at it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class GridMap:
    """A true map: which cells are free, where the robot starts and, for navigation, where it must go.

    Row 0 is the bottom row (y up), column 0 the left one; cell (row, column) covers
    ``[origin + column * resolution, origin + (column + 1) * resolution)`` in x, likewise in y. Everything outside
    the grid is occupied.

    Attributes:
        name: file name or generator name with seed; unique within a source.
        free: bool, shape (rows, columns).
        resolution: metres per cell.
        origin: (x, y) of the lower left corner, metres.
        start: (x, y) of the robot's start, metres, in free space.
        target: (x, y) of the navigation target, metres, or None.
        target_region: cells of the target's marker, bool, shape of ``free``, or None.
        lattice_origin: (x, y) of one point of the viewpoint lattice that suits this map, metres.
    """

    name: str
    free: NDArray[np.bool_]
    resolution: float
    origin: tuple[float, float]
    start: tuple[float, float]
    target: tuple[float, float] | None
    target_region: NDArray[np.bool_] | None
    lattice_origin: tuple[float, float]

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, metres."""
        return self.free.shape[1] * self.resolution, self.free.shape[0] * self.resolution

    @property
    def free_area(self) -> float:
        """Free area, square metres."""
        return float(np.count_nonzero(self.free)) * self.resolution**2

    def cell(self, position: tuple[float, float]) -> tuple[int, int]:
        """Return the (row, column) that holds a position; it may lie outside the grid."""
        return (
            int(np.floor((position[1] - self.origin[1]) / self.resolution)),
            int(np.floor((position[0] - self.origin[0]) / self.resolution)),
        )

    def is_free(self, position: tuple[float, float]) -> bool:
        """Whether a position lies in a free cell of the grid."""
        row, column = self.cell(position)
        rows, columns = self.free.shape
        return 0 <= row < rows and 0 <= column < columns and bool(self.free[row, column])
