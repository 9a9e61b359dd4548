"""The grid of what was measured, whatever it is made from: scans, an OctoMap of point clouds, or the map of a SLAM."""

from __future__ import annotations

from math import floor

from common.errors import MappingError
from common.geometry import Pose
from deploy.config import DeployConfig
from deploy.mapping.contradiction import Contradiction
from deploy.mapping.fit import MapFit
from deploy.mapping.log_odds import Beams, LogOddsGrid
from deploy.mapping.measured_grid import MeasuredGrid
from deploy.mapping.new_map import NewMapWatch
from deploy.mapping.octomap import OctoMap
from deploy.mapping.slam_grid import SlamGrid, resample
from deploy.mapping.waiting import Cloud


class Survey:
    """Makes the grid; not thread-safe.

    Attributes:
        cells: the grid; None before anything was measured.
        integrated: scans, clouds and maps that went into it.
        fit: whether scans fit it, after a leap of the pose; what is made of something else than scans is not compared.
        contradiction: whether scans contradict each other.
        new_map: whether a SLAM's map is another one than before.
    """

    def __init__(self, config: DeployConfig) -> None:
        """Begin with nothing measured.

        Raises:
            MappingError: OctoMap is wanted and not installed, or not made from point clouds.
        """
        sensing, mapping = config.sensing, config.mapping
        if sensing.octomap and sensing.source != "points":
            raise MappingError(
                f"sensing.octomap needs sensing.source 'points', got {sensing.source!r}: correct one of the two"
            )
        self._mapping = mapping
        self._sensing = sensing
        self.cells: MeasuredGrid | None = None
        self.integrated = 0
        self.fit = MapFit()
        self.new_map = NewMapWatch()
        self.contradiction = Contradiction()
        self._octomap: OctoMap | None = None
        if sensing.octomap:
            self._octomap = OctoMap(sensing, min(sensing.range_max or mapping.sensor_range, mapping.sensor_range))

    @property
    def by_octomap(self) -> bool:
        """Whether clouds count as they are, and not as beams."""
        return self._octomap is not None

    @property
    def misplaced(self) -> str:
        """Why the robot may not be where the map has it, or home not where it was, one sentence; empty otherwise."""
        return self.fit.problem or self.new_map.problem

    def add_beams(self, beams: Beams, sensor: Pose) -> None:
        """Add a scan to the log-odds, or hold it back while it is in doubt whether it fits.

        Raises:
            MappingError: it cannot be added; nothing is.
        """
        if not isinstance(self.cells, LogOddsGrid):
            self.cells = LogOddsGrid(self._mapping.resolution, self._near_anchor(sensor.position), self._sensing)
        for admitted, place in self.fit.admit(self.cells, beams, sensor):
            self.contradiction.look(self.cells, admitted, place)
            self.cells.integrate(admitted, place)
            self.integrated += 1

    def add_cloud(self, cloud: Cloud) -> None:
        """Add a point cloud to the OctoMap, and what it changed there to the grid."""
        assert self._octomap is not None, "clouds are added where sensing.octomap is set"
        self._octomap.insert(cloud)
        self.integrated += 1
        columns = self._octomap.columns
        changed = columns.take_changes()
        if changed is None:
            return
        if self.cells is None:
            self.cells = MeasuredGrid(self._mapping.resolution, self._near_anchor(cloud.sensor[:2]))
        (x, y), voxel = columns.origin, columns.resolution
        top, bottom, left, right = changed
        part = (x + left * voxel, y + top * voxel, x + (right + 1) * voxel, y + (bottom + 1) * voxel)
        grid = SlamGrid(columns.states, voxel, (x, y, 0.0))
        self.cells.write(*resample(grid, self._sensing, self._mapping.resolution, self.cells.anchor, part))

    def take_map(self, grid: SlamGrid) -> None:
        """Take a SLAM's map, in the map frame, in place of the last one.

        Raises:
            MappingError: it is no map; the last one stays.
        """
        grid.check()
        if self.cells is None:
            # Cells on the corners of the SLAM's own need no resampling where the sizes agree.
            anchor = grid.origin[:2] if abs(grid.origin[2]) < 1e-6 else self._near_anchor(grid.origin[:2])
            self.cells = MeasuredGrid(self._mapping.resolution, anchor)
        cells, row, column = resample(grid, self._sensing, self._mapping.resolution, self.cells.anchor)
        self.new_map.take(self.cells, cells, row, column)
        self.cells.replace(cells, row, column)
        self.integrated += 1

    def _near_anchor(self, position: tuple[float, float]) -> tuple[float, float]:
        """Return a cell corner near a position, the same in every run, with the lattice half a cell beside it."""
        spacing = self._mapping.viewpoint_spacing
        return floor(position[0] / spacing) * spacing, floor(position[1] / spacing) * spacing
