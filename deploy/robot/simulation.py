"""The simulated robot without topics: physics, base, odometry, lidar, mapping, one control interval at a time."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from actors.maps.grid_map import GridMap
from actors.maps.sources import open_sources, recommended
from common.config import SimulatorConfig
from common.geometry import Pose, Scan
from common.system.closing import Closing
from common.system.extras import optional
from deploy.config import DeployConfig
from deploy.network_config import TopicsConfig
from deploy.robot import defaults
from deploy.robot.drive_base import DriveBase
from deploy.robot.follower import WaypointFollower
from deploy.robot.odometry import Odometry, compose, correction, relative
from deploy.robot.options import RobotOptions
from deploy.robot.people import HEIGHT, RADIUS, People
from deploy.robot.slam import RobotSlam

if TYPE_CHECKING:
    from actors.simulators.dynamic import DynamicSimulator

RANGE_MIN = 0.1
"""The lidar reports nothing nearer, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """A grid of the robot's own mapping: cells int8 (-1, 0, 100), their size, and the lower left corner, metres."""

    cells: NDArray[np.int8]
    resolution: float
    origin: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """The robot after one control interval, and what its sensors told in it.

    Attributes:
        time: seconds since the start.
        truth: pose in the map frame.
        estimate: pose in the map frame as the robot's localisation tells it.
        odometry: pose in the odometry's frame.
        odometry_due: whether the odometry is to be told.
        velocity: measured, m/s and rad/s.
        scan: planar scan, when one was made.
        cloud: lidar points, metres, float32, shape (n, 3), in the frame that the configuration asks for.
        grid: of the robot's own mapping.
    """

    time: float
    truth: Pose
    estimate: Pose
    odometry: Pose
    odometry_due: bool
    velocity: tuple[float, float]
    scan: Scan | None = None
    cloud: NDArray[np.float32] | None = None
    grid: Grid | None = None

    @property
    def correction(self) -> tuple[float, float, float]:
        """The transform map -> odom, (x, y, yaw)."""
        return correction(self.estimate, self.odometry)


class SimulatedRobot(Closing):
    """A differential-drive robot in a world of its own; the map frame begins where the robot does.

    Usage::

        with SimulatedRobot(options, config) as robot:
            robot.base.receive(0.5, 0.0, now, robot.time)
            moment = robot.step(now)
    """

    def __init__(self, options: RobotOptions, config: DeployConfig) -> None:
        """Open the physics server and put the robot on its start.

        Raises:
            SimulatorError: PyBullet is not installed.
            MapError: the map cannot be used.
        """
        self.options = options
        self._config = config
        self.world = centred(load_world(options))
        self._simulator = _simulator(options, config.topics, config.mapping.sensor_range)
        self.interval = _control_interval()
        self.base = DriveBase(options)
        self.follower = WaypointFollower(config.driving) if options.follows(config.driving) else None
        self._steps = 0
        self._truth = self._simulator.reset(self.world, options.seed)
        self.people = People(self.world, options.people, options.seed) if options.people else None
        if self.people is not None:
            self._simulator.physics.add_pillars(self.people.positions, RADIUS, HEIGHT)
        self._odometry = Odometry(self._truth, options.odometry_drift, options.seed)
        self._slam = (
            RobotSlam(self.world, config.mapping.resolution, config.mapping.sensor_range, options.rays)
            if config.topics.map
            else None
        )
        if self._slam is not None:
            # The first look compiles, which must not happen while time runs.
            self._slam.look(self._truth)
        self._obstacles = np.zeros((0, 2))
        self.distance = 0.0
        self._lidar_timer = _Timer(options.scan_rate)
        self._odometry_timer = _Timer(options.odometry_rate)
        self._map_timer = _Timer(options.map_rate)
        self._follow_timer = _Timer(config.driving.rate)

    @property
    def time(self) -> float:
        """Seconds since the start, on the robot's clock."""
        return self._steps * self.interval

    @property
    def pose(self) -> Pose:
        """True pose in the map frame."""
        return self._truth

    @property
    def collisions(self) -> int:
        """Contacts with walls and people that began since the start."""
        return self._simulator.collisions

    @property
    def lidar_height(self) -> float:
        """Height of the lidar above the floor, metres."""
        return self._simulator.lidar_height

    def step(self, now: float) -> Moment:
        """Live for one control interval and return what came of it.

        Args:
            now: seconds of the clock that velocities are timed out by.

        Raises:
            SimulatorError: the robot tipped over.
        """
        time = self.time
        before = self._truth
        if self.follower is not None and self._follow_timer.due(time):
            period = 1.0 / self._config.driving.rate
            command = self.follower.command(before, self.base.commanded, self._obstacles, period, now)
            self.base.receive(*command, now, time)
        if self.people is not None:
            self.people.step(self.interval, before.position)
            self._simulator.physics.move_pillars(self.people.positions)
        truth = self._simulator.advance(*self.base.advance(now, time, self.interval))
        self._steps += 1
        self._truth = truth
        ahead, left, turned = relative(before, truth)
        self.distance += float(np.hypot(ahead, left))
        odometry = self._odometry.update(truth)
        # Without TF the odometry itself is the pose in the map frame, with all its drift.
        estimate = odometry if self._config.sensing.pose == "odometry" else truth
        scan = cloud = None
        if self._lidar_timer.due(self.time):
            scan = self._scan(truth)
            if self._config.topics.points:
                cloud = self._cloud(truth, estimate)
        return Moment(
            time=self.time,
            truth=truth,
            estimate=estimate,
            odometry=odometry,
            odometry_due=self._odometry_timer.due(self.time),
            velocity=(ahead / self.interval, turned / self.interval),
            scan=scan,
            cloud=cloud,
            grid=self._grid(),
        )

    def close(self) -> None:
        """Shut the physics server down; safe to call twice."""
        self._simulator.close()

    def _scan(self, truth: Pose) -> Scan:
        scan = dataclasses.replace(self._simulator.scan(), range_min=RANGE_MIN)
        if self._slam is not None and self.people is None:
            self._slam.look(truth)
        elif self._slam is not None:
            self._slam.take(scan, truth)
        angles = truth.yaw + scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
        met = np.isfinite(scan.ranges)
        ranges = scan.ranges[met].astype(np.float64)
        self._obstacles = np.column_stack(
            [truth.x + ranges * np.cos(angles[met]), truth.y + ranges * np.sin(angles[met])]
        )
        return scan

    def _cloud(self, truth: Pose, estimate: Pose) -> NDArray[np.float32]:
        if self._config.sensing.points_frame == "sensor":
            return self._simulator.point_cloud(in_sensor=True).astype(np.float32)
        cloud = self._simulator.point_cloud()
        if estimate != truth:
            # What is registered by a wrong pose lies in the wrong place.
            origin = compose(estimate, relative(truth, Pose(0.0, 0.0)))
            cosine, sine = np.cos(origin.yaw), np.sin(origin.yaw)
            cloud[:, :2] = cloud[:, :2] @ np.array([[cosine, sine], [-sine, cosine]]) + origin.position
        return cloud.astype(np.float32)

    def _grid(self) -> Grid | None:
        if self._slam is None or not self._map_timer.due(self.time):
            return None
        return Grid(*self._slam.grid())


class _Timer:
    """Tells at a rate that something is due; the first time at once."""

    def __init__(self, rate: float) -> None:
        self._period = 1.0 / rate
        self._count = 0

    def due(self, time: float) -> bool:
        if time < self._count * self._period - 1e-9:
            return False
        self._count = int(time / self._period + 1e-6) + 1
        return True


def load_world(options: RobotOptions) -> GridMap:
    """Load the world that the options name.

    Raises:
        MapError: it cannot be used.
    """
    scale = options.metres_per_pixel or recommended(options.map).metres_per_pixel or defaults.METRES_PER_PIXEL
    return open_sources([options.map], scale, "exploration").world(options.seed)


def centred(world: GridMap) -> GridMap:
    """Return a world with its origin where the robot starts, as localisation on a robot has it."""
    x, y = world.start

    def moved(position: tuple[float, float]) -> tuple[float, float]:
        return position[0] - x, position[1] - y

    return dataclasses.replace(
        world,
        origin=moved(world.origin),
        start=(0.0, 0.0),
        target=None if world.target is None else moved(world.target),
        lattice_origin=moved(world.lattice_origin),
    )


def _simulator(options: RobotOptions, topics: TopicsConfig, sensor_range: float) -> DynamicSimulator:
    with optional("hd-deploy robot", "pybullet"):
        from actors.simulators.dynamic import DynamicSimulator

    settings = SimulatorConfig(
        fidelity="dynamic",
        rays=options.rays,
        lidar_layers=options.lidar_layers(topics),
        range_noise=options.range_noise,
        speed=options.max_speed,
    )
    return DynamicSimulator(settings, sensor_range)


def _control_interval() -> float:
    from actors.simulators.dynamic import CONTROL_INTERVAL

    return CONTROL_INTERVAL
