"""The belief: what the robot knows of its world, cell by cell, as a ROS OccupancyGrid carries it."""

from __future__ import annotations

from math import ceil, floor, isfinite
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.errors import MappingError
from common.geometry import Pose, Scan
from common.mapping.growing_grid import GrowingGrid
from common.mapping.raycast import (
    SUBCELL_BITS,
    SUBCELLS,
    cell_behind_border,
    enter_next_cell,
    ray_axis,
    ray_units,
)
from common.mapping.sight import FREE, OCCUPIED, OUTSIDE, UNKNOWN
from common.system.jit import njit

# A range is trusted to this much, metres: a beam that ends so near to a cell border hit the cell behind the border,
# and one that ends so near to two borders (a corner) does not tell which cell it hit.
RANGE_TOLERANCE: Final = 1e-3
MAX_CELLS: Final = 1 << 28


@njit(cache=True, nogil=True)
def _integrate(
    cells: NDArray[np.int8],
    width: int,
    start_x: float,
    start_y: float,
    ranges: NDArray[np.float32],
    first_angle: float,
    angle_increment: float,
    range_min: float,
    limit: float,
    resolution: float,
) -> tuple[int, int, bool, int, int, int, int]:
    """Mark what a scan tells; all beams start at (start_x, start_y) cells, `limit` is in metres.

    Returns:
        Change of the number of known cells, change of the number of free cells, whether a beam left the grid, and the
        box of changed cells (first row, last row, first column, last column).
    """
    known = 0
    freed = 0
    outside = False
    row_low, row_high, column_low, column_high = 1 << 40, -1, 1 << 40, -1
    start = int(np.floor(start_y)) * width + int(np.floor(start_x))
    for beam in range(len(ranges)):
        measured = np.float64(ranges[beam])
        if not (measured >= range_min and measured >= 0.0):
            continue
        hit = measured < limit - RANGE_TOLERANCE
        reach = measured if hit else limit
        # Cells that the beam leaves before `stop` are passed; a border up to `end` may be the face that it hit.
        stop = ray_units((reach - RANGE_TOLERANCE) / resolution)
        end = ray_units((reach + RANGE_TOLERANCE) / resolution)
        angle = first_angle + angle_increment * beam
        step_x, next_x, delta_x = ray_axis(start_x, np.cos(angle))
        step_y, next_y, delta_y = ray_axis(start_y, np.sin(angle))
        step_y *= width
        index = start
        # A beam runs one way, so the first and the last cell that it changes span all that it changes.
        first = last = -1
        while min(next_x, next_y) < stop:
            if cells[index] < FREE:
                if cells[index] == OUTSIDE:
                    break
                cells[index] = FREE
                known += 1
                freed += 1
                last = index
                if first < 0:
                    first = index
            index, next_x, next_y = enter_next_cell(index, step_x, step_y, next_x, next_y, delta_x, delta_y)
        # The beam ends in this cell, or on its border to the next one.
        ahead = min(next_x, next_y)
        face = hit and ahead <= end
        if cells[index] == OUTSIDE:
            outside = True
        else:
            if (face or not hit) and cells[index] == UNKNOWN:
                cells[index] = FREE
                known += 1
                freed += 1
                last = index
                if first < 0:
                    first = index
            met = index if hit and not face else -1
            if face:
                met = cell_behind_border(index, step_x, step_y, next_x, next_y, delta_x, delta_y, end)
            if met >= 0 and cells[met] == OUTSIDE:
                outside = True
            elif met >= 0 and cells[met] != OCCUPIED:
                known += cells[met] == UNKNOWN
                freed -= cells[met] == FREE
                cells[met] = OCCUPIED
                last = met
                if first < 0:
                    first = met
        if first >= 0:
            for index in (first, last):
                row, column = index // width, index % width
                row_low, row_high = min(row_low, row), max(row_high, row)
                column_low, column_high = min(column_low, column), max(column_high, column)
    return known, freed, outside, row_low, row_high, column_low, column_high


class Belief(GrowingGrid):
    """What the robot knows: unknown (-1), free (0) or occupied (100) for every cell.

    It grows when a scan reaches beyond what is allocated. Boxes of changes are those of the padded grid.

    A scan is taken at its word: the cells before a beam's end are free, the cell at its end is occupied, and an
    occupied cell stays occupied. `_integrate` is the only place that classifies cells.
    """

    max_cells = MAX_CELLS

    def __init__(
        self,
        resolution: float,
        sensor_range: float,
        *,
        anchor: tuple[float, float] = (0.0, 0.0),
        bounds: tuple[float, float, float, float] | None = None,
    ) -> None:
        """Create an unknown belief.

        Args:
            resolution: metres per cell.
            sensor_range: metres; longer readings count as nothing met at this range.
            anchor: (x, y) of a point that lies on a corner of cells, metres; ignored where `bounds` are given.
            bounds: x_min, y_min, x_max, y_max to allocate at first, metres; its lower left corner is the anchor.

        Raises:
            MappingError: the bounds are empty, not finite or too large.
        """
        super().__init__(resolution, anchor if bounds is None else (bounds[0], bounds[1]))
        self.sensor_range = sensor_range
        self._padded = np.full((2, 2), OUTSIDE, dtype=np.int8)
        self._free = 0
        self._known = 0
        self._generation = 0
        if bounds is not None:
            x_min, y_min, x_max, y_max = bounds
            if not (all(isfinite(b) for b in bounds) and x_max > x_min and y_max > y_min):
                raise MappingError(
                    f"bounds must be finite with x_min < x_max and y_min < y_max, got {bounds}: "
                    "pass (x_min, y_min, x_max, y_max) in metres, or None to let the belief grow from nothing"
                )
            columns = ceil((x_max - x_min) / resolution - 1e-6)
            rows = ceil((y_max - y_min) / resolution - 1e-6)
            self.cover(0, rows, 0, columns)
            self._generation, self._changed = 0, None

    @property
    def cells(self) -> NDArray[np.int8]:
        """The grid, int8, shape (rows, columns), row 0 at the bottom; a read-only view, replaced when it grows."""
        view = self._padded[1:-1, 1:-1]
        view.flags.writeable = False
        return view

    @property
    def free_area(self) -> float:
        """Area known to be free, square metres."""
        return self._free * self.resolution**2

    @property
    def known_cells(self) -> int:
        """Number of cells known to be free or occupied."""
        return self._known

    @property
    def padded(self) -> NDArray[np.int8]:
        """The grid with its ring of OUTSIDE cells, as kernels want it; only this class writes to it."""
        return self._padded

    @property
    def generation(self) -> int:
        """Rises whenever the grid is allocated anew, so that cell indices of older generations are void."""
        return self._generation

    def subcells(self, position: tuple[float, float]) -> tuple[int, int]:
        """Return a position in subcells from the lower left corner of the padded grid."""
        # As `to_subcells` rounds, but a call of a kernel for two numbers takes five times as long.
        x = round(float(position[0] - self.anchor[0]) / self.resolution * SUBCELLS)
        y = round(float(position[1] - self.anchor[1]) / self.resolution * SUBCELLS)
        row, column = self._first
        return x - ((column - 1) << SUBCELL_BITS), y - ((row - 1) << SUBCELL_BITS)

    def cell(self, position: tuple[float, float]) -> tuple[int, int]:
        """Return the (row, column) that holds a position; it may lie outside the grid."""
        x, y = self.subcells(position)
        return (y >> SUBCELL_BITS) - 1, (x >> SUBCELL_BITS) - 1

    def at(self, position: tuple[float, float]) -> int:
        """Return what is known of a position: -1, 0 or 100; -1 outside the grid."""
        row, column = self.cell(position)
        rows, columns = self.shape
        inside = 0 <= row < rows and 0 <= column < columns
        return int(self._padded[row + 1, column + 1]) if inside else UNKNOWN

    def window(self, origin: tuple[float, float], shape: tuple[int, int]) -> NDArray[np.int8]:
        """Return a copy of the cells of a rectangle, unknown where the grid does not reach.

        Compare a belief that may have grown with a true map by this: ``window(world.origin, world.free.shape)``.

        Args:
            origin: (x, y) of the lower left corner, metres, on a corner of cells.
            shape: rows and columns.
        """
        row, column = self.cell(origin)
        rows, columns = self.shape
        out = np.full(shape, UNKNOWN, dtype=np.int8)
        low_row, high_row = max(row, 0), min(row + shape[0], rows)
        low_column, high_column = max(column, 0), min(column + shape[1], columns)
        if low_row < high_row and low_column < high_column:
            out[low_row - row : high_row - row, low_column - column : high_column - column] = self._padded[
                low_row + 1 : high_row + 1, low_column + 1 : high_column + 1
            ]
        return out

    def integrate(self, scan: Scan, pose: Pose) -> int:
        """Add a scan made at a pose, traversing each beam exactly cell by cell (Amanatides and Woo, 1987).

        A range at or above `range_max`, or beyond the sensor range, frees the cells up to there and marks no wall;
        NaN and ranges below `range_min` are ignored. A beam that ends at a common corner of cells marks no wall,
        because it does not tell which of them it met.

        Returns:
            Number of cells that became known.

        Raises:
            MappingError: the pose or the scan's geometry is not finite, or the belief would grow beyond reason.
        """
        limit = min(scan.range_max, self.sensor_range)
        numbers = (pose.x, pose.y, pose.yaw, scan.angle_min, scan.angle_increment)
        if not all(isfinite(number) for number in numbers) or not limit > 0.0:
            raise MappingError(
                f"a scan needs a finite pose and finite angles, and range_max above 0, got {pose} and angle_min "
                f"{scan.angle_min}, angle_increment {scan.angle_increment}, range_max {scan.range_max}: drop this scan"
            )
        ranges = np.ascontiguousarray(scan.ranges, dtype=np.float32)
        row, column = self.cell(pose.position)
        rows, columns = self.shape
        if not (0 <= row < rows and 0 <= column < columns):
            self._grow(pose, limit)
        known = 0
        while True:
            x, y = self.subcells(pose.position)
            gained, freed, outside, *box = _integrate(
                self._padded.reshape(-1),
                self._padded.shape[1],
                x / SUBCELLS,
                y / SUBCELLS,
                ranges,
                pose.yaw + scan.angle_min,
                scan.angle_increment,
                scan.range_min,
                limit,
                self.resolution,
            )
            known += gained
            self._known += gained
            self._free += freed
            if box[1] >= 0:
                self.note((box[0], box[1], box[2], box[3]))
            if not outside:
                return known
            # What the beams told before they left the grid stays; saying it again changes nothing.
            self._grow(pose, limit)

    def assign(self, cells: NDArray[np.int8], origin: tuple[float, float]) -> None:
        """Replace a rectangle of cells, as when the robot's own SLAM publishes its OccupancyGrid.

        Args:
            cells: -1, 0 or 100, int8, shape (rows, columns), row 0 at the bottom.
            origin: (x, y) of its lower left corner, metres; rounded to the nearest corner of cells.

        Raises:
            MappingError: another value than -1, 0 and 100, or not two dimensions.
        """
        if cells.ndim != 2 or not np.isin(cells, (UNKNOWN, FREE, OCCUPIED)).all():
            raise MappingError(
                f"cells must be a two-dimensional array of -1, 0 and 100, got shape {cells.shape}: "
                "threshold occupancy probabilities before"
            )
        if cells.size == 0:
            return
        row = round((origin[1] - self.anchor[1]) / self.resolution)
        column = round((origin[0] - self.anchor[0]) / self.resolution)
        self.cover(row, row + cells.shape[0], column, column + cells.shape[1])
        top, left = row - self._first[0] + 1, column - self._first[1] + 1
        part = self._padded[top : top + cells.shape[0], left : left + cells.shape[1]]
        self._free += int(np.count_nonzero(cells == FREE)) - int(np.count_nonzero(part == FREE))
        self._known += int(np.count_nonzero(cells != UNKNOWN)) - int(np.count_nonzero(part != UNKNOWN))
        part[:] = cells
        self.note((top, top + cells.shape[0] - 1, left, left + cells.shape[1] - 1))

    def _grow(self, pose: Pose, limit: float) -> None:
        """Allocate what a scan at a pose can reach, and half as much again where the grid has to move its border."""
        cells = limit / self.resolution
        x = (pose.x - self.anchor[0]) / self.resolution
        y = (pose.y - self.anchor[1]) / self.resolution
        if max(abs(x), abs(y), cells) > self.max_cells:
            self._refuse(max(abs(x), abs(y), cells), max(abs(x), abs(y), cells))
        near, far = ceil(cells) + 2, ceil(1.5 * cells) + 2
        rows, columns = self.shape
        row_low, column_low = self._first
        row_high, column_high = row_low + rows, column_low + columns
        if rows == 0 or columns == 0:
            row_low = row_high = floor(y)
            column_low = column_high = floor(x)
        row, column = floor(y), floor(x)
        self.cover(
            row - far if row - near < row_low else row_low,
            row + far if row + near > row_high else row_high,
            column - far if column - near < column_low else column_low,
            column + far if column + near > column_high else column_high,
        )

    def _move(self, before: tuple[int, int, int, int] | None) -> None:
        rows, columns = self._shape
        padded = np.full((rows + 2, columns + 2), OUTSIDE, dtype=np.int8)
        padded[1:-1, 1:-1] = UNKNOWN
        if before is not None:
            top, bottom, left, right = before
            padded[top + 1 : bottom + 1, left + 1 : right + 1] = self._padded[1:-1, 1:-1]
        self._padded = padded
        self._generation += 1
        self._changed = (1, rows, 1, columns)
