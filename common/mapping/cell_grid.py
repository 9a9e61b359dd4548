"""What kernels and graphs need to know about a grid of cells, whoever owns it."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray


class CellGrid(Protocol):
    """Cells and where they lie: a belief, or a view of one."""

    @property
    def padded(self) -> NDArray[np.int8]:
        """The cells with a ring around them, int8, shape (rows + 2, columns + 2), row 0 at the bottom."""
        ...

    @property
    def resolution(self) -> float:
        """Metres per cell."""
        ...

    @property
    def origin(self) -> tuple[float, float]:
        """(x, y) of the lower left corner of cell (0, 0), metres."""
        ...


class AnchoredGrid(CellGrid, Protocol):
    """A grid whose cells keep their numbers from a fixed anchor when it is allocated anew."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns, without the ring."""
        ...

    @property
    def first_cell(self) -> tuple[int, int]:
        """(row, column) of cell (0, 0), counted from the anchor."""
        ...

    def subcells(self, position: tuple[float, float]) -> tuple[int, int]:
        """Return a position in subcells from the lower left corner of the padded grid."""
        ...


class ClearGrid(NamedTuple):
    """Where the robot fits in known free space, as a `CellGrid` for lines of sight: 0 where all points are clear."""

    padded: NDArray[np.int8]
    resolution: float
    origin: tuple[float, float]
