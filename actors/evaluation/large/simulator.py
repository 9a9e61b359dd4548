"""The dynamic simulator with a record of when and where the lidar scanned, and the volume that it saw."""

from __future__ import annotations

from actors.evaluation.large.lidar import GridLidar
from actors.evaluation.large.voxels import VoxelMap
from actors.evaluation.outcome import TrackPoint
from actors.maps.grid_map import GridMap
from actors.simulators.dynamic import DynamicSimulator
from common.config import SimulatorConfig
from common.geometry import Pose, Scan


class NotedSimulator(DynamicSimulator):
    """Notes every scan, also those made on the way, from `begin` on; its lidar is a `GridLidar`.

    Attributes:
        track: where the robot was at every scan since `begin`; resets of the world do not end it.
        voxels: what it saw.
    """

    def __init__(self, config: SimulatorConfig, sensor_range: float) -> None:
        super().__init__(config, sensor_range)
        self._lidar = self._grid_lidar = GridLidar(self._beams, config.lidar_layers, config.wall_height)
        self._height = config.wall_height
        self._elapsed = self._since = 0.0
        self.track: list[TrackPoint] = []
        self.voxels: VoxelMap | None = None

    @property
    def elapsed(self) -> float:
        """Simulated seconds of driving since `begin`; the time in which the robot settles after a reset is none."""
        return self._elapsed + self.time - self._since

    @property
    def volume(self) -> float:
        """Volume that it saw since `begin`, cubic metres."""
        return 0.0 if self.voxels is None else self.voxels.volume

    def begin(self, world: GridMap) -> None:
        """Begin a new episode with an empty notebook."""
        self.track = []
        self.voxels = VoxelMap(world, self._height)
        self._elapsed, self._since = 0.0, self.time

    def reset(self, world: GridMap, seed: int) -> Pose:
        """Load a world, put the robot on its start and return its pose."""
        self._elapsed = self.elapsed
        self._grid_lidar.enter(world)
        pose = super().reset(world, seed)
        self._since = self.time
        return pose

    def scan(self) -> Scan:
        """Scan from where the robot stands."""
        scan = super().scan()
        if self.voxels is not None:
            self.voxels.add(self.point_cloud())
            pose = self.pose
            # Tenths of a millimetre are far below what contacts and ranges are exact to.
            self.track.append(
                TrackPoint(round(self.elapsed, 3), round(pose.x, 4), round(pose.y, 4), round(pose.yaw, 4))
            )
        return scan
