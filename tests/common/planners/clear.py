"""Clear space of cells that are given, from scratch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.mapping.cell_grid import ClearGrid
from common.mapping.clearance import Clearance
from common.mapping.sight import NOTHING_LOST, OUTSIDE

Cells = NDArray[np.int8]


def clear_space(cells: Cells, radius: float) -> tuple[Cells, Cells]:
    """Return cells with a ring around them, and where a disc of some radius, cells, fits."""
    padded = np.pad(cells, 1, constant_values=OUTSIDE)
    clearance = Clearance(ClearGrid(padded, 1.0, (0.0, 0.0)), radius)
    rows, columns = padded.shape
    clearance.refresh(padded, (1, rows - 2, 1, columns - 2), NOTHING_LOST)
    return padded, clearance.grid
