"""The robot's map: sensor messages and poses in, the common Mapper out."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from common.errors import MappingError
from common.geometry import Pose, Scan
from common.mapping.mapper import Mapper
from deploy.config import DeployConfig
from deploy.mapping.belief_writer import BeliefWriter
from deploy.mapping.grid_intake import GridIntake
from deploy.mapping.intake import Intake, StampedTransform
from deploy.mapping.log_odds import Beams
from deploy.mapping.slam_grid import SlamGrid, strangeness
from deploy.mapping.survey import Survey
from deploy.tf.leaps import PoseLeaps

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
        misplaced: why the robot may not be where the map has it, or home not where it was, one sentence; or empty.
        outdated: which link of TF is too old to tell a pose, in words with a remedy; empty while none is.
    """

    received: int = 0
    integrated: int = 0
    waiting: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    problem: str = ""
    free_area: float = 0.0
    explored_volume: float = 0.0
    misplaced: str = ""
    outdated: str = ""


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
        self._config = config
        # The intake is filled by subscriber threads and must never wait for the map's arithmetic.
        self._intake_lock = threading.Lock()
        self._map_lock = threading.Lock()
        self._intake = Intake(config.frames, config.sensing, config.mapping.sensor_range, config.driving)
        self._grids = GridIntake(self._intake, config.frames.map, wanted=config.sensing.source == "grid")
        self._target = target
        self._survey = Survey(config)
        self._writer: BeliefWriter | None = None
        safety = config.safety
        self._leaps = PoseLeaps(
            jump=safety.pose_jump, speed=safety.speed_limit, turn_rate=safety.turn_limit, timeout=safety.pose_timeout
        )
        self._leapt = ""

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
            base = self._intake.add_pose(time, pose, floor, frame, child)
            if base is not None:
                self._look_for_leap(time, base)
            return base

    def add_transforms(self, transforms: Iterable[StampedTransform], *, static: bool = False) -> float | None:
        """Add transforms, for poses (``sensing.pose: tf``) and for where sensors sit on the base.

        Args:
            transforms: (stamp, parent, child, (x, y, z), (x, y, z, w)).
            static: they come from /tf_static and hold for ever.

        Returns:
            The newest stamp of those that move the base, seconds; None without, and where poses come by odometry.
        """
        with self._intake_lock:
            moved = self._intake.add_transforms(transforms, static)
            pose = None if moved is None else self._intake.pose
            if moved is not None and pose is not None:
                self._look_for_leap(moved, pose)
            return moved

    def add_scan(self, time: float, scan: Scan, frame: str = "", sweep: float = 0.0) -> None:
        """Add a range scan; where ``sensing.source`` is another one it counts for `obstacles_near` alone.

        Args:
            time: its stamp, that of the first beam, seconds of the robot's clock.
            scan: in the sensor's frame.
            frame: that of its header; where the robot has no TF, ``sensing.sensor_offset`` counts.
            sweep: time from the first beam to the last, seconds; 0 where all are of one moment.
        """
        with self._intake_lock:
            self._intake.add_scan(time, scan, frame, sweep)

    def add_points(
        self, time: float, points: NDArray[np.float32], frame: str = "", times: NDArray[np.float64] | None = None
    ) -> None:
        """Add a point cloud; where ``sensing.source`` is another one it counts for `obstacles_near` alone.

        Args:
            time: its stamp, seconds of the robot's clock.
            points: shape (n, 3 or more), metres; copied.
            frame: that of its header: the map frame, or one that TF knows; ``sensing.points_frame`` counts where there
                is none, or where the robot has no TF.
            times: when each point was measured, seconds after the stamp, shape (n,); None where all are of one moment.
        """
        with self._intake_lock:
            self._intake.add_points(time, points, frame, times)

    def refuse(self, reason: str, problem: str) -> None:
        """Count a sensor message that is no part of the map.

        Args:
            reason: what is wrong, in a word or two.
            problem: the same in a sentence.
        """
        with self._intake_lock:
            self._intake.messages.received += 1
            self._intake.messages.drop(reason, problem)

    def note(self, problem: str) -> None:
        """Tell the operator once of something strange about messages that are used all the same."""
        with self._intake_lock:
            self._intake.messages.note(problem)

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
            self._grids.add(time, cells, resolution, origin, frame)

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
                grid = self._grids.take()
                pose = self._intake.pose
                leapt, self._leapt = self._leapt, ""
            if leapt and self._survey.cells is not None:
                if self._config.sensing.source == "grid":
                    self._survey.new_map.leapt(leapt)
                else:
                    self._survey.fit.doubt(leapt)
            if self._survey.by_octomap:
                if cloud is not None:
                    self._survey.add_cloud(cloud)
            else:
                for beams, sensor in ready:
                    self._use_beams(beams, sensor)
            if grid is not None:
                self._use_grid(grid)
            cells = self._survey.cells
            if pose is None or cells is None or cells.empty:
                return None
            if self._writer is None:
                self._writer = BeliefWriter(
                    self._config.mapping,
                    self._config.sensing,
                    cells,
                    self._target,
                    self._config.driving.robot_radius,
                )
            self._writer.write(pose)
            if not self._survey.misplaced:
                self._writer.mapper.passed(pose)
            self._writer.mapper.update(pose)
            return self._writer.mapper

    @property
    def pose(self) -> Pose | None:
        """Newest pose of the base in the map frame; None while there is none."""
        with self._intake_lock:
            return self._intake.pose

    @property
    def swing(self) -> str:
        """Which link to the base two publishers contest, by the transforms added last; empty without."""
        with self._intake_lock:
            return self._intake.swing

    @property
    def problem(self) -> str:
        """The last thing that went wrong, one line; empty when nothing did."""
        with self._intake_lock:
            return self._intake.messages.problem

    @property
    def statistics(self) -> MapStatistics:
        """What became of the sensor messages, since the last reset where it is about the map."""
        with self._intake_lock:
            intake, cells = self._intake, self._survey.cells
            return MapStatistics(
                received=intake.messages.received + self._grids.received,
                integrated=self._survey.integrated,
                waiting=intake.waiting,
                dropped=dict(intake.messages.dropped),
                problem=intake.messages.problem,
                free_area=0.0 if cells is None else cells.free_area,
                explored_volume=intake.volume.value,
                misplaced=self._survey.misplaced,
                outdated=intake.outdated,
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
                cells = self._survey.cells
                return _NO_POINTS if cells is None else cells.occupied_near(pose.position, radius)
        return points[np.hypot(points[:, 0] - pose.x, points[:, 1] - pose.y) <= radius]

    def occupancy(self) -> tuple[NDArray[np.int8], float, tuple[float, float]] | None:
        """Return the map as it was measured, None while there is none.

        Returns:
            Copy of the cells (-1, 0, 100; int8, row 0 at the bottom), metres per cell, (x, y) of its lower left corner.
        """
        with self._map_lock:
            cells = self._survey.cells
            if cells is None or cells.empty:
                return None
            return cells.states.copy(), cells.resolution, cells.origin

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
            self._grids.again()
            self._leapt = ""
            self._survey = Survey(self._config)
            self._writer = None

    def _look_for_leap(self, time: float, pose: Pose) -> None:
        """Note where a pose does not continue the one before; the caller holds the intake."""
        leapt = self._leaps.take(time, pose)
        if leapt:
            self._intake.part()
            self._leapt = leapt

    def _use_beams(self, beams: Beams, sensor: Pose) -> None:
        """Add a scan to the map; one that cannot be is dropped."""
        try:
            self._survey.add_beams(beams, sensor)
        except MappingError as error:
            self._drop("scan refused", error)
        self.note(self._survey.contradiction.note)

    def _use_grid(self, grid: SlamGrid) -> None:
        """Take a SLAM map; one that is no map leaves the last one in place."""
        strange = strangeness(grid.cells, self._config.sensing)
        if strange:
            with self._intake_lock:
                self._intake.messages.warn(strange)
        try:
            self._survey.take_map(grid)
        except MappingError as error:
            self._drop("grid refused", error)

    def _drop(self, reason: str, error: MappingError) -> None:
        with self._intake_lock:
            self._intake.messages.drop(reason, str(error))
