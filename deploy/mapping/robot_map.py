"""The robot's map: sensor messages and poses in, the common Mapper out."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from math import floor

import numpy as np
from numpy.typing import NDArray

from common.errors import MappingError
from common.geometry import Pose, Scan
from common.mapping.mapper import Mapper
from deploy.config import DeployConfig
from deploy.mapping.belief_writer import BeliefWriter
from deploy.mapping.intake import Intake, StampedTransform
from deploy.mapping.log_odds import Beams, LogOddsGrid
from deploy.mapping.measured_grid import MeasuredGrid
from deploy.mapping.octomap import OctoMap
from deploy.mapping.slam_grid import SlamGrid, resample, strangeness
from deploy.mapping.transforms import Transform
from deploy.safety.stamps import Order, StampOrder

logger = logging.getLogger(__name__)

_NO_POINTS = np.empty((0, 2))


@dataclass(frozen=True, slots=True)
class MapStatistics:
    """What became of the sensor messages.

    Attributes:
        received: scans, clouds and grids that came.
        integrated: those that went into the map.
        waiting: those that wait for a pose.
        dropped: how many were dropped, by reason.
        problem: the last thing that went wrong, one line; empty when nothing did.
        free_area: area known to be free, square metres.
        explored_volume: voxels of 0.5 m with a point in them, cubic metres; 0 without clouds.
    """

    received: int = 0
    integrated: int = 0
    waiting: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    problem: str = ""
    free_area: float = 0.0
    explored_volume: float = 0.0


class RobotMap:
    """What the robot knows, made from what its sensors say; every method may be called from any thread.

    Usage::

        robot_map = RobotMap(config)
        robot_map.add_pose(time, pose)  # from subscriber threads, as messages come
        robot_map.add_scan(time, scan)
        mapper = robot_map.refresh()  # from the decision thread, which alone uses the mapper
    """

    def __init__(self, config: DeployConfig, target: tuple[float, float] | None = None) -> None:
        """Begin with an unknown map; ``target`` is the navigation target in the map frame, metres.

        Raises:
            MappingError: OctoMap is wanted and not installed, or not made from point clouds.
        """
        if config.sensing.octomap and config.sensing.source != "points":
            raise MappingError(
                f"sensing.octomap needs sensing.source 'points', got {config.sensing.source!r}: correct one of the two"
            )
        self._config = config
        # The intake is filled by subscriber threads and must never wait for the map's arithmetic.
        self._intake_lock = threading.Lock()
        self._map_lock = threading.Lock()
        self._intake = Intake(config.frames, config.sensing, config.mapping.sensor_range)
        self._grids_received = 0
        self._grid_order = StampOrder()
        # The newest map is kept: one that is latched comes only once.
        self._grid_newest: tuple[SlamGrid, str] | None = None
        self._grid_pending: tuple[SlamGrid, str] | None = None
        self._target = target
        self._cells: MeasuredGrid | None = None
        self._writer: BeliefWriter | None = None
        self._octomap: OctoMap | None = None
        self._integrated = 0
        self.reset(target)

    def add_pose(self, time: float, pose: Pose, floor: float = 0.0, frame: str = "", child: str = "") -> Pose | None:
        """Add a pose of the odometry (``sensing.pose: odometry``).

        Args:
            time: its stamp, seconds of the robot's clock.
            pose: of the frame ``child``.
            floor: height of the floor below it in the map frame, metres; counts for clouds in the map frame.
            frame: that of the pose, which is taken for the map frame unless TF says that it is another.
            child: the base, when not given; for another frame of the robot TF tells where the base is.

        Returns:
            The pose of the base in the map frame; None where it does not count.
        """
        with self._intake_lock:
            return self._intake.add_pose(time, pose, floor, frame, child)

    def add_transforms(self, transforms: Iterable[StampedTransform], *, static: bool = False) -> None:
        """Add transforms, for poses (``sensing.pose: tf``) and for where sensors sit on the base.

        Args:
            transforms: (stamp, parent, child, (x, y, z), (x, y, z, w)).
            static: they come from /tf_static and hold for ever.
        """
        with self._intake_lock:
            self._intake.add_transforms(transforms, static)

    def add_scan(self, time: float, scan: Scan, frame: str = "") -> None:
        """Add a range scan; where ``sensing.source`` is another one it counts for `obstacles_near` alone.

        Args:
            time: its stamp, seconds of the robot's clock.
            scan: in the sensor's frame.
            frame: that of its header; where the robot has no TF, ``sensing.sensor_offset`` counts.
        """
        with self._intake_lock:
            self._intake.add_scan(time, scan, frame)

    def add_points(self, time: float, points: NDArray[np.float32], frame: str = "") -> None:
        """Add a point cloud; where ``sensing.source`` is another one it counts for `obstacles_near` alone.

        Args:
            time: its stamp, seconds of the robot's clock.
            points: shape (n, 3 or more), metres; copied.
            frame: that of its header: the map frame, or one that TF knows; ``sensing.points_frame`` counts where there
                is none, or where the robot has no TF.
        """
        with self._intake_lock:
            self._intake.add_points(time, points, frame)

    def refuse(self, reason: str, problem: str) -> None:
        """Count a sensor message that is no part of the map.

        Args:
            reason: what is wrong, in a word or two.
            problem: the same in a sentence.
        """
        with self._intake_lock:
            self._intake.received += 1
            self._intake.drop(reason, problem)

    def note(self, problem: str) -> None:
        """Tell the operator once of something strange about messages that are used all the same."""
        with self._intake_lock:
            self._intake.note(problem)

    def add_grid(
        self,
        time: float,
        cells: NDArray[np.int8],
        resolution: float,
        origin: tuple[float, float, float],
        frame: str = "",
    ) -> None:
        """Take the map of the robot's own SLAM (``sensing.source: grid``); only the newest one counts.

        One in another frame than the map's waits until TF tells where that frame lies.

        Args:
            time: its stamp, seconds of the robot's clock.
            cells: -1 or 0 to 100, int8, shape (rows, columns), row 0 at the bottom.
            resolution: metres per cell.
            origin: x, y (metres) and yaw (radians) of the lower left corner of cell (0, 0).
            frame: that of its header, in which the origin is.
        """
        with self._intake_lock:
            self._grids_received += 1
            if self._config.sensing.source != "grid":
                self._intake.drop("grid not wanted", "an OccupancyGrid arrived, but sensing.source is not 'grid'")
            elif self._grid_order.take(time) is Order.LATE:
                self._intake.drop("grid outdated", "an OccupancyGrid arrived after a newer one")
            elif cells.max(initial=-1) == 1:
                self._intake.drop(
                    "grid refused",
                    "an OccupancyGrid's cells are percentages, -1 unknown, 0 free to 100 occupied; none of this one "
                    "is above 1, so its walls would be free: publish 100 instead of 1",
                )
            else:
                self._grid_newest = self._grid_pending = SlamGrid(cells, resolution, origin), frame

    def refresh(self) -> Mapper | None:
        """Apply what came and bring the Mapper up to date at the newest pose.

        Returns:
            The Mapper, the same one until `reset`; None while there is no pose or nothing is known yet.

        Raises:
            MappingError: the map would grow beyond reason, or more viewpoints are reachable than a policy can take.
        """
        with self._map_lock:
            with self._intake_lock:
                self._intake.resolve()
                ready = list(self._intake.ready)
                self._intake.ready.clear()
                cloud, self._intake.cloud = self._intake.cloud, None
                grid = self._placed_grid()
                pose = self._intake.pose
            if self._octomap is not None and cloud is not None:
                self._octomap.insert(cloud)
                self._use_octomap(self._octomap, cloud.sensor)
                self._integrated += 1
            elif self._octomap is None:
                for beams, sensor in ready:
                    self._integrate(beams, sensor)
            if grid is not None:
                self._use_grid(grid)
            if pose is None or self._cells is None or self._cells.empty:
                return None
            if self._writer is None:
                self._writer = BeliefWriter(
                    self._config.mapping,
                    self._config.sensing,
                    self._cells,
                    self._target,
                    self._config.driving.robot_radius,
                )
            self._writer.write(pose)
            self._writer.mapper.passed(pose)
            self._writer.mapper.update(pose)
            return self._writer.mapper

    @property
    def pose(self) -> Pose | None:
        """Newest pose of the base in the map frame; None while there is none."""
        with self._intake_lock:
            return self._intake.pose

    @property
    def statistics(self) -> MapStatistics:
        """What became of the sensor messages, since the last reset where it is about the map."""
        with self._intake_lock:
            intake = self._intake
            return MapStatistics(
                received=intake.received + self._grids_received,
                integrated=self._integrated,
                waiting=intake.waiting,
                dropped=dict(intake.dropped),
                problem=intake.problem,
                free_area=0.0 if self._cells is None else self._cells.free_area,
                explored_volume=intake.volume.value,
            )

    def obstacles_near(self, pose: Pose, radius: float) -> NDArray[np.float64]:
        """Return obstacles around a pose for a local costmap: those of the newest scan and cloud, else of the map.

        They are placed by the pose of their own moment, so that they stay where they are while the robot moves on.

        Returns:
            Points in the map frame, metres, shape (n, 2).
        """
        with self._intake_lock:
            points = self._intake.obstacles()
        if points is None:
            with self._map_lock:
                return _NO_POINTS if self._cells is None else self._cells.occupied_near(pose.position, radius)
        return points[np.hypot(points[:, 0] - pose.x, points[:, 1] - pose.y) <= radius]

    def occupancy(self) -> tuple[NDArray[np.int8], float, tuple[float, float]] | None:
        """Return the map as it was measured, None while there is none.

        Returns:
            Copy of the cells (-1, 0, 100; int8, row 0 at the bottom), metres per cell, (x, y) of its lower left corner.
        """
        with self._map_lock:
            if self._cells is None or self._cells.empty:
                return None
            return self._cells.states.copy(), self._cells.resolution, self._cells.origin

    def set_target(self, target: tuple[float, float] | None) -> None:
        """Set another navigation target, or none, and keep the map; it counts from the next refresh."""
        with self._map_lock:
            self._target = target
            if self._writer is not None:
                self._writer.mapper.target = target

    def reset(self, target: tuple[float, float] | None = None) -> None:
        """Forget the map and the scans, but not the poses; the next refresh makes a new Mapper with this target."""
        with self._map_lock, self._intake_lock:
            self._target = target
            self._intake.forget()
            self._grid_pending = self._grid_newest
            self._cells = self._writer = None
            self._grid_order = StampOrder()
            self._integrated = 0
            self._octomap = self._new_octomap()

    def _new_octomap(self) -> OctoMap | None:
        sensing, mapping = self._config.sensing, self._config.mapping
        if not sensing.octomap:
            return None
        return OctoMap(sensing, min(sensing.range_max or mapping.sensor_range, mapping.sensor_range))

    def _near_anchor(self, position: tuple[float, float]) -> tuple[float, float]:
        """Return a cell corner near a position, the same in every run, with the lattice half a cell beside it."""
        spacing = self._config.mapping.viewpoint_spacing
        return floor(position[0] / spacing) * spacing, floor(position[1] / spacing) * spacing

    def _integrate(self, beams: Beams, sensor: Pose) -> None:
        """Add a scan to the log-odds; one that cannot be is dropped."""
        if not isinstance(self._cells, LogOddsGrid):
            mapping = self._config.mapping
            self._cells = LogOddsGrid(mapping.resolution, self._near_anchor(sensor.position), self._config.sensing)
        try:
            self._cells.integrate(beams, sensor)
            self._integrated += 1
        except MappingError as error:
            with self._intake_lock:
                self._intake.drop("scan refused", str(error))

    def _use_octomap(self, octomap: OctoMap, sensor: tuple[float, float, float]) -> None:
        changed = octomap.columns.take_changes()
        if changed is None:
            return
        mapping = self._config.mapping
        if self._cells is None:
            self._cells = MeasuredGrid(mapping.resolution, self._near_anchor(sensor[:2]))
        columns = octomap.columns
        (x, y), voxel = columns.origin, columns.resolution
        top, bottom, left, right = changed
        part = (x + left * voxel, y + top * voxel, x + (right + 1) * voxel, y + (bottom + 1) * voxel)
        grid = SlamGrid(columns.states, voxel, (x, y, 0.0))
        self._cells.write(*resample(grid, self._config.sensing, mapping.resolution, self._cells.anchor, part))

    def _placed_grid(self) -> SlamGrid | None:
        """Return the map that came, in the map frame; None while there is none, or its frame is not known."""
        if self._grid_pending is None:
            return None
        grid, frame = self._grid_pending
        place = self._intake.world(frame)
        if place is None:
            self._intake.note(
                f"an OccupancyGrid is in the frame {frame!r}, and TF has no transform to {self._config.frames.map!r} "
                f"yet: publish it, or set frames.map={frame}"
            )
            return None
        self._grid_pending = None
        corner = (place @ Transform.planar(*grid.origin)).pose
        # What is not moved keeps its numbers: cells on the corners of the SLAM's own need no resampling.
        return grid if place == Transform() else replace(grid, origin=(corner.x, corner.y, corner.yaw))

    def _use_grid(self, grid: SlamGrid) -> None:
        """Take a SLAM map; one that is no map leaves the last one in place."""
        mapping, sensing = self._config.mapping, self._config.sensing
        strange = strangeness(grid.cells, sensing)
        if strange:
            with self._intake_lock:
                self._intake.warn(strange)
        try:
            grid.check()
            if self._cells is None:
                # Cells on the corners of the SLAM's own need no resampling where the sizes agree.
                anchor = grid.origin[:2] if abs(grid.origin[2]) < 1e-6 else self._near_anchor(grid.origin[:2])
                self._cells = MeasuredGrid(mapping.resolution, anchor)
            self._cells.replace(*resample(grid, sensing, mapping.resolution, self._cells.anchor))
            self._integrated += 1
        except MappingError as error:
            with self._intake_lock:
                self._intake.drop("grid refused", str(error))
