"""Writing the robot's grid into the common belief: room for the body, no pockets, only where something changed."""

from __future__ import annotations

from math import floor

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.sight import OCCUPIED, Box
from deploy.config import DeployConfig
from deploy.mapping.cells import CellGrid
from deploy.mapping.inflation import WAY_OUT, footprint, inflate, inflation_offsets
from deploy.mapping.pockets import Pockets


class BeliefWriter:
    """Keeps the belief of one Mapper equal to a grid in which walls are inflated and pockets closed.

    On the way to a target no pocket is closed: the target may lie in one.

    Attributes:
        mapper: whose belief it writes; its cells are those of the grid.
    """

    def __init__(self, config: DeployConfig, cells: CellGrid, target: tuple[float, float] | None) -> None:
        """Make a Mapper for a grid; ``target`` is the navigation target, metres."""
        driving, size = config.driving, cells.resolution
        x, y = cells.anchor
        # Viewpoints in the middle of cells: edges along the grid touch one row of cells, not two.
        self.mapper = Mapper(
            config.mapping,
            lattice_origin=(x + size / 2, y + size / 2),
            bounds=(x, y, x + size, y + size),
            target=target,
        )
        self._cells = cells
        self._radius = driving.robot_radius / size
        self._offsets = inflation_offsets(size, driving.robot_radius, driving.clearance)
        self._reach = int(np.abs(self._offsets).max(initial=0))
        self._robot_box: Box | None = None
        self._pockets = Pockets(config.sensing.pocket, size)
        self._closing = True
        self._moves = config.sensing.source == "grid"

    def write(self, pose: Pose) -> None:
        """Assign what changed since the last time, and the robot's own place where it stood and stands."""
        cells = self._cells
        rows, columns = cells.states.shape
        changed = cells.take_changes()
        regions = []
        closing = self.mapper.target is None
        # The map of a SLAM may move as a whole: what enclosed a pocket once may not do so now.
        moved = self._moves and changed is not None
        if moved:
            self._pockets.forget()
        if moved or not self._same_extent() or closing != self._closing:
            regions.append((0, rows - 1, 0, columns - 1))
        else:
            if changed is not None:
                regions.append(_clipped(changed, self._reach, rows, columns))
            if self._robot_box is not None:
                regions.append(self._robot_box)
        self._closing = closing
        row = (pose.y - cells.anchor[1]) / cells.resolution - cells.first[0]
        column = (pose.x - cells.anchor[0]) / cells.resolution - cells.first[1]
        self._robot_box = None
        place: NDArray[np.int8] | None = None
        if 0.0 <= row < rows and 0.0 <= column < columns:
            here = (floor(row), floor(row), floor(column), floor(column))
            self._robot_box = _clipped(here, int(WAY_OUT / cells.resolution) + 1, rows, columns)
            regions.append(self._robot_box)
            place = self._inflated(self._robot_box)
            footprint(cells.states, place, self._robot_box, (row, column), self._radius)
        for region in regions:
            out = self._inflated(region)
            if place is not None and self._robot_box is not None:
                _paste(out, region, place, self._robot_box)
            if closing:
                self._pockets.close(out, (cells.first[0] + region[0], cells.first[1] + region[2]))
            self._assign(region, out)
        if closing:
            self._close_new(regions)

    def _same_extent(self) -> bool:
        belief = self.mapper.belief
        return belief.shape == self._cells.states.shape and belief.first_cell == self._cells.first

    def _close_new(self, regions: list[Box]) -> None:
        """Close pockets that what was written has cut off."""
        if not regions:
            return
        # The robot's own place lies in what it scans: one look at both together.
        tops, bottoms, lefts, rights = zip(*regions, strict=True)
        belief = self.mapper.belief
        found = self._pockets.find(belief, (min(tops), max(bottoms), min(lefts), max(rights)))
        if len(found):
            (top, left), (bottom, right) = found.min(axis=0).tolist(), found.max(axis=0).tolist()
            part = belief.cells[top : bottom + 1, left : right + 1].copy()
            part[found[:, 0] - top, found[:, 1] - left] = OCCUPIED
            self._assign((top, bottom, left, right), part)

    def _inflated(self, box: Box) -> NDArray[np.int8]:
        out = np.empty((box[1] - box[0] + 1, box[3] - box[2] + 1), dtype=np.int8)
        inflate(self._cells.states, self._offsets, self._reach, box, out)
        return out

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


def _paste(out: NDArray[np.int8], box: Box, part: NDArray[np.int8], part_box: Box) -> None:
    """Copy a part into the cells of a box, where they overlap."""
    top, bottom = max(box[0], part_box[0]), min(box[1], part_box[1])
    left, right = max(box[2], part_box[2]), min(box[3], part_box[3])
    if top <= bottom and left <= right:
        out[top - box[0] : bottom - box[0] + 1, left - box[2] : right - box[2] + 1] = part[
            top - part_box[0] : bottom - part_box[0] + 1, left - part_box[2] : right - part_box[2] + 1
        ]
