"""The OccupancyGrid of the robot's own SLAM: thresholds, and resampling to the cells of the common map."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, cos, floor, isfinite, sin
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.errors import MappingError
from common.mapping.sight import FREE, OCCUPIED, UNKNOWN
from common.system.jit import njit
from deploy.config import SensingConfig
from deploy.mapping.measured_grid import MAX_CELLS

# A cell that reaches into another by less than this share of the other is beside it: origins are rounded numbers.
SHARE_TOLERANCE: Final = 0.01
# More than this share of the known cells between the thresholds is no map that the thresholds were made for.
STRANGE_SHARE: Final = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class SlamGrid:
    """A map that the robot's SLAM published.

    Attributes:
        cells: -1 unknown, 0 to 100 probability of an obstacle in percent, int8, shape (rows, columns).
        resolution: metres per cell.
        origin: x, y (metres) and yaw (radians) of the outer corner of cell (0, 0) in the map frame.
    """

    cells: NDArray[np.int8]
    resolution: float
    origin: tuple[float, float, float]

    def check(self) -> None:
        """Raise MappingError when this is no map."""
        if self.cells.ndim != 2 or self.cells.size == 0:
            raise MappingError(f"an OccupancyGrid needs rows and columns, got shape {self.cells.shape}: wait for a map")
        if not (self.resolution > 0.0 and isfinite(self.resolution) and all(isfinite(o) for o in self.origin)):
            raise MappingError(
                f"an OccupancyGrid needs a positive resolution and a finite origin, got {self.resolution} and "
                f"{self.origin}: correct its publisher"
            )


@njit(cache=True, nogil=True)
def _resample(
    source: NDArray[np.int8],
    scale: float,
    offset_x: float,
    offset_y: float,
    cosine: float,
    sine: float,
    out: NDArray[np.int8],
) -> None:
    """Fill the cells of `out` from those of `source` that they touch: occupied wins, then unknown.

    Args:
        source: -1, 0 or 100, int8, shape (rows, columns).
        scale: source cells per cell of `out`.
        offset_x: the corner of `out` in the frame of `source` before rotation, source cells.
        offset_y: likewise.
        cosine: of the yaw of `source`.
        sine: likewise.
        out: int8, shape (rows, columns).
    """
    rows, columns = source.shape
    # Half the side of the box around a rotated cell.
    half = 0.5 * scale * (abs(cosine) + abs(sine)) - SHARE_TOLERANCE
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            x, y = offset_x + (j + 0.5) * scale, offset_y + (i + 0.5) * scale
            u, v = cosine * x + sine * y, cosine * y - sine * x
            low_row, high_row = int(np.floor(v - half)), int(np.floor(v + half))
            low_column, high_column = int(np.floor(u - half)), int(np.floor(u + half))
            inside = low_row >= 0 and low_column >= 0 and high_row < rows and high_column < columns
            state = FREE if inside else UNKNOWN
            for row in range(max(low_row, 0), min(high_row, rows - 1) + 1):
                for column in range(max(low_column, 0), min(high_column, columns - 1) + 1):
                    if source[row, column] == OCCUPIED:
                        state = OCCUPIED
                        break
                    if source[row, column] == UNKNOWN:
                        state = UNKNOWN
                if state == OCCUPIED:
                    break
            out[i, j] = state


def classify(cells: NDArray[np.int8], config: SensingConfig) -> NDArray[np.int8]:
    """Return -1, 0 or 100 for each value of an OccupancyGrid by the thresholds; values outside 0 to 100 are unknown."""
    out = np.full(cells.shape, UNKNOWN, dtype=np.int8)
    out[(cells >= 0) & (cells <= config.grid_free)] = FREE
    out[(cells >= config.grid_occupied) & (cells <= 100)] = OCCUPIED
    return out


def strangeness(cells: NDArray[np.int8], config: SensingConfig) -> str:
    """Return what is strange about the values of an OccupancyGrid, one line; empty when nothing is."""
    known = cells[cells != UNKNOWN]
    if known.size == 0:
        return ""
    wrong = int(np.count_nonzero((known < 0) | (known > 100)))
    if wrong:
        return f"{wrong} values of the OccupancyGrid are neither -1 nor 0 to 100 and count as unknown"
    between = float(np.mean((known > config.grid_free) & (known < config.grid_occupied)))
    if between > STRANGE_SHARE:
        return (
            f"{between:.0%} of the OccupancyGrid's known values are between grid_free ({config.grid_free}) and "
            f"grid_occupied ({config.grid_occupied}) and count as unknown: adjust the two for this SLAM"
        )
    if not (known <= config.grid_free).any():
        return f"no value of the OccupancyGrid is at most grid_free ({config.grid_free}): nothing is free"
    highest = int(known.max())
    if 0 < highest <= config.grid_free:
        return (
            f"the OccupancyGrid's highest value is {highest}, at most grid_free ({config.grid_free}), so nothing is an "
            "obstacle: publish 100 for walls, or adjust sensing.grid_free and sensing.grid_occupied"
        )
    return ""


def resample(
    grid: SlamGrid,
    config: SensingConfig,
    resolution: float,
    anchor: tuple[float, float],
    part: tuple[float, float, float, float] | None = None,
) -> tuple[NDArray[np.int8], int, int]:
    """Return a SLAM map as cells of the common map.

    A cell is occupied when it touches an occupied one of the SLAM map, else unknown when it touches an unknown one or
    reaches beyond the map, else free. A rotated origin is treated likewise, with the box around the rotated cell.

    Args:
        grid: the map.
        config: its thresholds.
        resolution: of the common map, metres per cell.
        anchor: (x, y) of the lower left corner of cell (0, 0) of the common map's numbering, metres.
        part: x_min, y_min, x_max, y_max of what is wanted, metres; the whole map when not given.

    Returns:
        Cells of -1, 0 and 100, int8, and the numbers (row, column) of the first of them.

    Raises:
        MappingError: this is no map, or it would take too many cells.
    """
    grid.check()
    x, y, yaw = grid.origin
    # What is not rotated must not be so by the rounding of a quaternion.
    cosine, sine = (1.0, 0.0) if abs(yaw) < 1e-6 else (cos(yaw), sin(yaw))
    rows, columns = grid.cells.shape
    high, wide = rows * grid.resolution, columns * grid.resolution
    if part is None:
        corners_x = [x + a * cosine - b * sine for a in (0.0, wide) for b in (0.0, high)]
        corners_y = [y + a * sine + b * cosine for a in (0.0, wide) for b in (0.0, high)]
        part = (min(corners_x), min(corners_y), max(corners_x), max(corners_y))
    share = SHARE_TOLERANCE * grid.resolution / resolution
    column = floor((part[0] - anchor[0]) / resolution + share)
    row = floor((part[1] - anchor[1]) / resolution + share)
    end_column = ceil((part[2] - anchor[0]) / resolution - share)
    end_row = ceil((part[3] - anchor[1]) / resolution - share)
    if (end_row - row) * (end_column - column) > MAX_CELLS:
        raise MappingError(
            f"an OccupancyGrid of {rows} x {columns} cells of {grid.resolution:g} m would become {end_row - row} x "
            f"{end_column - column} cells of {resolution:g} m, more than {MAX_CELLS}: publish a smaller map, or use "
            "coarser cells (mapping.resolution)"
        )
    out = np.empty((end_row - row, end_column - column), dtype=np.int8)
    _resample(
        classify(grid.cells, config),
        resolution / grid.resolution,
        (anchor[0] + column * resolution - x) / grid.resolution,
        (anchor[1] + row * resolution - y) / grid.resolution,
        cosine,
        sine,
        out,
    )
    return out, row, column
