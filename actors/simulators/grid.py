"""The `grid` simulator: exact 2D ray traversal and straight motion, without physics."""

from __future__ import annotations

import numpy as np

from actors.maps.grid_map import GridMap
from actors.simulators.base import Leg, Watch
from actors.simulators.beams import BeamPattern
from actors.simulators.segment import follow_segment
from common.config import SimulatorConfig
from common.errors import SimulatorError
from common.geometry import Pose, Scan
from common.mapping.raycast import cast_rays


class GridSimulator:
    """A point robot on a grid map: the paper's benchmark protocol, and a host for machines without PyBullet.

    Of the configuration it uses ``rays``, ``sense_every``, ``speed`` and ``range_noise``.
    """

    def __init__(self, config: SimulatorConfig, sensor_range: float) -> None:
        """Set up the sensor with a range of ``sensor_range`` metres."""
        self._config = config
        self._beams = BeamPattern(config.rays, sensor_range, config.range_noise)
        self._world: GridMap | None = None
        self._pose = Pose(0.0, 0.0)

    @property
    def pose(self) -> Pose:
        """Where the robot stands."""
        return self._pose

    def set_sensor_range(self, metres: float) -> None:
        """Let the sensor reach so far from the next scan on."""
        self._beams.set_range(metres)

    def reset(self, world: GridMap, seed: int) -> Pose:
        """Load a world, put the robot on its start, facing along x, and return its pose."""
        check_start(world)
        self._world = world
        self._beams.reseed(seed)
        self._pose = Pose(*world.start)
        return self._pose

    def place(self, pose: Pose) -> None:
        """Put the robot somewhere else, without motion; `SimulatorError` when that is not free."""
        self._pose = check_free(self._loaded(), pose)

    def scan(self) -> Scan:
        """Scan from where the robot stands."""
        return self._scan_at(self._pose)

    def drive_to(self, waypoint: tuple[float, float], watch: Watch | None = None) -> Leg:
        """Move along the straight segment to a waypoint; a wall on it stops the robot before it, a watch on its way."""
        self._loaded()
        leg = follow_segment(
            self._pose,
            waypoint,
            free_distance=self._free_distance,
            sense=self._scan_at,
            speed=self._config.speed,
            sense_every=self._config.sense_every,
            watch=watch,
        )
        self._pose = leg.pose
        return leg

    def close(self) -> None:
        """Release the world; safe to call twice."""
        self._world = None

    def _loaded(self) -> GridMap:
        if self._world is None:
            raise SimulatorError("the simulator has no world: call reset(world, seed) first")
        return self._world

    def _scan_at(self, pose: Pose) -> Scan:
        world = self._loaded()
        angles = self._beams.angles + pose.yaw
        ranges = cast_rays(world.free, world.resolution, *world.origin, pose.x, pose.y, angles, self._beams.range_max)
        if self._beams.noise > 0.0:
            return self._beams.to_scan(self._beams.disturb(ranges.astype(np.float64)))
        return self._beams.to_scan(ranges)

    def _free_distance(self, pose: Pose, length: float) -> float:
        world = self._loaded()
        angle = np.array([pose.yaw])
        return float(cast_rays(world.free, world.resolution, *world.origin, pose.x, pose.y, angle, length)[0])


def check_start(world: GridMap) -> None:
    """Raise `SimulatorError` when the start of a world is not free."""
    if not world.is_free(world.start):
        raise SimulatorError(
            f"map {world.name!r}: expected a start in free space, got {world.start}: correct the map or its marker"
        )


def check_free(world: GridMap, pose: Pose) -> Pose:
    """Return the pose; `SimulatorError` when its position is not in free space."""
    if not world.is_free(pose.position):
        raise SimulatorError(f"map {world.name!r}: cannot put the robot at {pose.position}, which is not free space")
    return pose
