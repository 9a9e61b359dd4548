"""A mapper that keeps a margin around obstacles, for robots that have a size."""

from __future__ import annotations

from math import ceil

import numpy as np
from numpy.typing import NDArray

from common.config.schema import MappingConfig
from common.errors import MappingError
from common.geometry import Pose, Scan
from common.mapping.belief import Belief
from common.mapping.mapper import Mapper
from common.mapping.sight import FREE, OCCUPIED, Box


class InflatedMapper(Mapper):
    """A mapper whose belief shows free cells near obstacles as occupied.

    Scans go into a belief of their own; what planners see is a copy in which every free cell whose centre is less than
    ``inflation`` from an occupied cell counts as occupied. Unknown cells stay unknown, so that the margin tells nothing
    that was not seen. Cells around the robot stay as they were seen: a robot that was pushed into the margin must be
    able to leave it.
    """

    def __init__(
        self,
        config: MappingConfig,
        *,
        inflation: float,
        lattice_origin: tuple[float, float],
        bounds: tuple[float, float, float, float] | None = None,
        target: tuple[float, float] | None = None,
    ) -> None:
        """Start with an unknown belief; arguments as `Mapper` takes them.

        Args:
            config: resolution, ranges and spacing.
            inflation: metres; 0 for none.
            lattice_origin: (x, y) of one point of the viewpoint lattice, metres.
            bounds: x_min, y_min, x_max, y_max that are allocated at first, metres.
            target: (x, y) of the navigation target, metres.

        Raises:
            MappingError: the inflation is negative or no number, or as `Mapper` says.
        """
        if not 0.0 <= inflation < config.viewpoint_spacing:
            raise MappingError(
                f"inflation must be at least 0 and below the viewpoint spacing ({config.viewpoint_spacing} m), "
                f"got {inflation}: pass about the robot's radius in metres"
            )
        super().__init__(config, lattice_origin=lattice_origin, bounds=bounds, target=target)
        self._seen = Belief(config.resolution, config.sensor_range, anchor=lattice_origin, bounds=bounds)
        self._seen_generation = self._seen.generation
        self._margin = _offsets(inflation / config.resolution)
        self._reach = ceil(inflation / config.resolution)
        self._robot_cells: Box | None = None

    def integrate(self, scan: Scan, pose: Pose) -> int:
        """Add a scan and return the number of cells that became known; planners see it after the next `update`."""
        return self._seen.integrate(scan, pose)

    def update(self, pose: Pose) -> None:
        """Bring the belief, then everything that is made of it, up to date; see `Mapper.update`."""
        if np.isfinite(pose.position).all():
            self._inflate(pose)
        super().update(pose)

    def _inflate(self, pose: Pose) -> None:
        """Write what changed, with its margin, into the belief that planners see."""
        seen, reach = self._seen, self._reach
        changed = seen.take_changes()
        if seen.generation != self._seen_generation:
            self._seen_generation = seen.generation
            self._robot_cells = None
        rows, columns = seen.shape
        boxes = []
        if changed is not None:
            # Cells of the padded grid begin one before those of the grid.
            low_row, high_row, low_column, high_column = (number - 1 for number in changed)
            boxes.append((low_row - reach, high_row + reach, low_column - reach, high_column + reach))
        if self._robot_cells is not None:
            boxes.append(self._robot_cells)
        row, column = seen.cell(pose.position)
        self._robot_cells = (row - reach, row + reach, column - reach, column + reach)
        boxes.append(self._robot_cells)
        for box in boxes:
            top, bottom = max(box[0], 0), min(box[1] + 1, rows)
            left, right = max(box[2], 0), min(box[3] + 1, columns)
            if top < bottom and left < right:
                self._write(top, bottom, left, right, (row, column))

    def _write(self, top: int, bottom: int, left: int, right: int, robot: tuple[int, int]) -> None:
        """Copy a half-open rectangle of cells with its margins."""
        seen, reach = self._seen, self._reach
        rows, columns = seen.shape
        cells = seen.cells
        part = cells[top:bottom, left:right].copy()
        around = np.zeros((bottom - top + 2 * reach, right - left + 2 * reach), dtype=np.bool_)
        low, high = max(top - reach, 0), min(bottom + reach, rows)
        first, last = max(left - reach, 0), min(right + reach, columns)
        shift_row, shift_column = top - reach, left - reach
        around[low - shift_row : high - shift_row, first - shift_column : last - shift_column] = (
            cells[low:high, first:last] == OCCUPIED
        )
        near = np.zeros(part.shape, dtype=np.bool_)
        for down, across in self._margin:
            y, x = reach + down, reach + across
            near |= around[y : y + part.shape[0], x : x + part.shape[1]]
        row, column = robot[0] - top, robot[1] - left
        low, high = max(row - reach, 0), max(row + reach + 1, 0)
        near[low:high, max(column - reach, 0) : max(column + reach + 1, 0)] = False
        part[near & (part == FREE)] = OCCUPIED
        x_min, y_min = seen.origin
        self.belief.assign(part, (x_min + left * seen.resolution, y_min + top * seen.resolution))


def _offsets(reach: float) -> list[tuple[int, int]]:
    """Return (row, column) offsets of the cells that a cell's centre is nearer to than ``reach`` cells."""
    span = np.arange(-ceil(reach), ceil(reach) + 1)
    gap: NDArray[np.float64] = np.maximum(np.abs(span) - 0.5, 0.0)
    near = np.hypot(gap[:, None], gap[None, :]) < reach
    return [(int(span[row]), int(span[column])) for row, column in np.argwhere(near)]
