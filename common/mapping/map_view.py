"""What planners read of a mapper: the observation, the cells that are known and free, and the viewpoint graph."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from common.config import ImageScale
from common.errors import MappingError
from common.geometry import Pose
from common.mapping.cell_grid import ClearGrid
from common.mapping.clearance import CLEAR_CELL, SWEEP_TOLERANCE, TIGHT, sweep
from common.mapping.frontiers import Frontiers, middles
from common.mapping.graph_view import GraphView
from common.mapping.occupancy_image import image_reaches, occupancy_image
from common.mapping.raycast import SUBCELL_BITS, SUBCELLS
from common.mapping.sight import CLEAR, blocker
from common.mapping.utility import FrontierUtility
from common.observations.observation import Observation


class MapView(GraphView):
    """The state after the last update of a `Mapper`, which is the one that makes it; nothing here changes it.

    Nodes, edges and paths are those of `GraphView`; here is what cells tell.
    """

    _pose: Pose | None
    _frontiers: Frontiers
    _utility: FrontierUtility
    # How a robot that is cut off gets back to clear space of its viewpoint; mostly empty.
    _back: list[tuple[float, float]]
    _cut_off: tuple[float, float] | None

    def observe(self, *, image: ImageScale | None = None) -> Observation:
        """Return the observation of the last update.

        Args:
            image: by what the images of the belief are measured, which cost 0.2 ms; None for none.

        Raises:
            MappingError: there was no update yet, or no viewpoint can be reached from the pose (see `stuck`).
        """
        if self._pose is None:
            raise MappingError("nothing to observe yet: call update(pose) after integrating a scan")
        if self.stuck:
            raise MappingError(
                f"({self._pose.x:.2f}, {self._pose.y:.2f}) is not in known free space where a robot of radius "
                f"{self._config.robot_radius:g} m fits, and there is none nearby: integrate more scans, move the "
                "robot into free space, or use a smaller mapping.robot_radius"
            )
        if image is None:
            return self._observation
        reaches = image_reaches(image, self._config)
        drawn = occupancy_image(self.belief, self.position(self._robot), reaches)
        return replace(self._observation, image=drawn)

    @property
    def cut_off(self) -> tuple[float, float] | None:
        """Where the robot has been and can get to no more although more is left to see from there, metres; mostly None.

        Something has closed the way that it came, and where it can get to, nothing is left.
        """
        return self._cut_off

    @property
    def explored_area(self) -> float:
        """Area known to be free, square metres."""
        return self.belief.free_area

    @property
    def frontiers(self) -> NDArray[np.float64]:
        """Centres of all frontier cells, row-major, metres, shape (m, 2)."""
        # The grid may have grown since the update.
        frontiers = self._frontiers
        found: NDArray[np.float64] = middles(
            frontiers.flat, frontiers.padded_mask.shape[1], self.belief.resolution, *self._origin
        )
        return found

    @property
    def frontier_cells(self) -> tuple[NDArray[np.int64], int]:
        """Flat numbers of the frontier cells in the padded grid, ordered as `frontiers`, and the length of its rows."""
        return self._frontiers.flat, self._frontiers.padded_mask.shape[1]

    def sightings(self) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
        """Return which frontier cells each viewpoint of the last update observes: in range and in line of sight.

        Returns:
            Sparse rows by node number: the first entry of each, int64, shape (n + 1,), and the entries, places in
            `frontiers`, ascending within a row, int32.
        """
        return self._utility.sightings(self._frontiers.flat, self._numbers, len(self._order))

    @property
    def clear(self) -> ClearGrid:
        """Where the robot fits in known free space: straight segments through its cells of value 0 keep the radius."""
        cells = self._graph.cells
        return ClearGrid(cells.clear.reshape(-1, cells.width), self._config.resolution, self.belief.origin)

    @property
    def frontier_mask(self) -> NDArray[np.bool_]:
        """Frontier cells, bool, shape of the belief's padded grid; a copy."""
        return self._frontiers.padded_mask.copy()

    def way_home(self) -> list[tuple[float, float]]:
        """Return where to drive from the pose of the last update to the robot's viewpoint, that included, metres.

        A robot that is cut off from it goes back as it came, see `Mapper.update`.

        Raises:
            MappingError: the robot is stuck.
        """
        self.observe()
        assert self._pose is not None
        goal = self.position(self._robot)
        if self.segment_free(self._pose.position, goal):
            return [goal]
        back = self._back
        start = back[-1] if back else self._pose.position
        return [*back, *self.way_inside(self._robot, start, goal)]

    def segment_free(self, a: tuple[float, float], b: tuple[float, float]) -> bool:
        """Whether the robot can drive straight from one position to another through what is known to be free.

        A point may touch free cells alone; a robot with a radius keeps that from everything that is not free, or, where
        it starts nearer, does not come nearer still.
        """
        rows, columns = self.belief.shape
        points = (*self.belief.subcells(a), *self.belief.subcells(b))
        for x, y in (points[:2], points[2:]):
            if not (1 <= x >> SUBCELL_BITS <= columns and 1 <= y >> SUBCELL_BITS <= rows):
                return False
        cells = self._graph.cells
        if blocker(cells.clear, cells.width, *points) == CLEAR:
            return True
        radius = self._config.robot_radius / self._config.resolution
        if radius <= 0.0 or blocker(cells.belief, cells.width, *points) != CLEAR:
            return False
        x0, y0, x1, y1 = (value / SUBCELLS for value in points)
        wanted = sweep(cells.belief, cells.width, x0, y0, x0, y0, radius)
        return bool(sweep(cells.belief, cells.width, x0, y0, x1, y1, wanted) >= wanted - SWEEP_TOLERANCE)

    @property
    def room(self) -> NDArray[np.bool_]:
        """Cells in whose middle the robot fits by what is known, bool, shape of the belief's padded grid; a copy."""
        clear = self._graph.cells.clear.reshape(self.belief.padded.shape)
        return (clear == CLEAR_CELL) | (clear == TIGHT)

    def has_room(self, position: tuple[float, float]) -> bool:
        """Whether the robot fits where the middle of a position's cell is, by what is known."""
        row, column = self.belief.cell(position)
        rows, columns = self.belief.shape
        if not (0 <= row < rows and 0 <= column < columns):
            return False
        cells = self._graph.cells
        return int(cells.clear[(row + 1) * cells.width + column + 1]) in (CLEAR_CELL, TIGHT)
