"""Writing the robot's grid into the common belief: as it was seen but for rims and holes, where something changed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.config import MappingConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.sight import OCCUPIED, Box
from deploy.config import SensingConfig
from deploy.mapping.footprint import clear_footprint, footprint_box
from deploy.mapping.measured_grid import MeasuredGrid
from deploy.mapping.rims import close_rims, rim_offsets
from deploy.mapping.small_holes import SmallHoles


class BeliefWriter:
    """Keeps the belief of one Mapper equal to a grid, but for the robot's own place, which is free.

    In an exploration what is not worth a look, rims and holes, is closed: shown as occupied. On the way to a target
    nothing is, because the target may lie there. How much room the robot needs is the Mapper's business
    (``mapping.robot_radius``).

    Attributes:
        mapper: whose belief it writes; its cells are those of the grid.
    """

    def __init__(
        self,
        mapping: MappingConfig,
        sensing: SensingConfig,
        cells: MeasuredGrid,
        target: tuple[float, float] | None,
        robot_radius: float,
    ) -> None:
        """Make a Mapper for a grid.

        Args:
            mapping: of the mapper.
            sensing: where the grid comes from, and how large holes are closed.
            cells: the grid.
            target: of navigation, metres.
            robot_radius: of the circle around the robot's centre that is free where the robot stands, metres.
        """
        size = cells.resolution
        x, y = cells.anchor
        # Viewpoints in the middle of cells: edges along the grid touch one row of cells, not two.
        self.mapper = Mapper(
            mapping,
            lattice_origin=(x + size / 2, y + size / 2),
            bounds=(x, y, x + size, y + size),
            target=target,
        )
        self._cells = cells
        self._radius = robot_radius / size
        self._rims = rim_offsets(size, mapping.robot_radius)
        self._reach = int(np.abs(self._rims).max(initial=0))
        self._robot_box: Box | None = None
        self._holes = SmallHoles(sensing.hole_area, size)
        self._closing = True
        self._moves = sensing.source == "grid"

    def write(self, pose: Pose) -> None:
        """Assign what changed since the last time, and the robot's own place where it stood and stands."""
        cells = self._cells
        rows, columns = cells.states.shape
        changed = cells.take_changes()
        regions = []
        closing = self.mapper.target is None
        # The map of a SLAM may move as a whole: what enclosed a hole once may not do so now.
        moved = self._moves and changed is not None
        if moved:
            self._holes.forget()
        if moved or not self._same_extent() or closing != self._closing:
            regions.append((0, rows - 1, 0, columns - 1))
        else:
            if changed is not None:
                # Whether a cell is a rim depends on obstacles around the places from where the robot would cover it.
                regions.append(_clipped(changed, 2 * self._reach, rows, columns))
            if self._robot_box is not None:
                regions.append(self._robot_box)
        self._closing = closing
        row = (pose.y - cells.anchor[1]) / cells.resolution - cells.first_cell[0]
        column = (pose.x - cells.anchor[0]) / cells.resolution - cells.first_cell[1]
        self._robot_box = None
        if 0.0 <= row < rows and 0.0 <= column < columns:
            self._robot_box = footprint_box((row, column), self._radius, (rows, columns))
            regions.append(self._robot_box)
        for region in regions:
            top, bottom, left, right = region
            part = cells.states[top : bottom + 1, left : right + 1].copy()
            if self._robot_box is not None:
                clear_footprint(part, region, (row, column), self._radius)
            if closing:
                close_rims(cells.states, self._rims, self._reach, region, part)
                self._holes.close(part, (cells.first_cell[0] + top, cells.first_cell[1] + left))
            self._assign(region, part)
        if closing:
            self._close_new(regions)

    def _same_extent(self) -> bool:
        belief = self.mapper.belief
        return belief.shape == self._cells.states.shape and belief.first_cell == self._cells.first_cell

    def _close_new(self, regions: list[Box]) -> None:
        """Close holes that what was written has cut off."""
        if not regions:
            return
        # The robot's own place lies in what it scans: one look at both together.
        tops, bottoms, lefts, rights = zip(*regions, strict=True)
        belief = self.mapper.belief
        found = self._holes.find(belief, (min(tops), max(bottoms), min(lefts), max(rights)))
        if len(found):
            (top, left), (bottom, right) = found.min(axis=0).tolist(), found.max(axis=0).tolist()
            part = belief.cells[top : bottom + 1, left : right + 1].copy()
            part[found[:, 0] - top, found[:, 1] - left] = OCCUPIED
            self._assign((top, bottom, left, right), part)

    def _assign(self, box: Box, new: NDArray[np.int8]) -> None:
        """Assign the cells of a box to the belief, the differences alone."""
        cells, belief = self._cells, self.mapper.belief
        top, left = box[0], box[2]
        if self._same_extent():
            differ = belief.cells[top : box[1] + 1, left : box[3] + 1] != new
            rows, columns = np.flatnonzero(differ.any(axis=1)), np.flatnonzero(differ.any(axis=0))
            if len(rows) == 0:
                return
            new = new[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
            top, left = top + int(rows[0]), left + int(columns[0])
        x, y = cells.origin
        belief.assign(new, (x + left * cells.resolution, y + top * cells.resolution))


def _clipped(box: Box, margin: int, rows: int, columns: int) -> Box:
    """Return a box with a margin around it, cut to the grid."""
    return (
        max(box[0] - margin, 0),
        min(box[1] + margin, rows - 1),
        max(box[2] - margin, 0),
        min(box[3] + margin, columns - 1),
    )
