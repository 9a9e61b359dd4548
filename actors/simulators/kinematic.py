"""The `pybullet` simulator in kinematic fidelity: lidar in the physics world, the robot carried along segments."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from actors.maps.grid_map import GridMap
from actors.simulators.base import Leg, Watch
from actors.simulators.grid import check_free
from actors.simulators.lidar import free_distance
from actors.simulators.physics_simulator import PhysicsSimulator
from actors.simulators.robot import Robot
from actors.simulators.segment import follow_segment
from actors.simulators.view import follow_with_camera
from common.config import SimulatorConfig
from common.geometry import Pose, Scan

_COLLISION_HEIGHT = 0.15
_FRAME = 1.0 / 30.0


class KinematicSimulator(PhysicsSimulator):
    """A robot that is carried along the straight segment, with lidar rays in a PyBullet world."""

    def __init__(
        self, config: SimulatorConfig, sensor_range: float, *, gui: bool = False, visible: bool = False
    ) -> None:
        """Open a physics server.

        Args:
            config: sensor and speed.
            sensor_range: metres.
            gui: open PyBullet's window; the robot then moves in real time.
            visible: give the world colours, for rendering without a window.
        """
        super().__init__(config, sensor_range, gui=gui, visible=visible)
        self._pose = Pose(0.0, 0.0)

    @property
    def pose(self) -> Pose:
        """Where the robot stands."""
        return self._pose

    def reset(self, world: GridMap, seed: int) -> Pose:
        """Load a world, put the robot on its start, facing along x, and return its pose."""
        self._load(world, seed)
        self._pose = Pose(*world.start)
        self._robot = Robot(self.physics, self._pose, collides=False)
        if self.physics.gui:
            follow_with_camera(self.physics.client, self._pose, fresh=True)
        return self._pose

    def place(self, pose: Pose) -> None:
        """Put the robot somewhere else, without motion; `SimulatorError` when that is not free."""
        robot, world = self._loaded()
        self._pose = check_free(world, pose)
        robot.place(pose)

    def scan(self) -> Scan:
        """Scan from where the robot stands."""
        return self._scan_at(self._pose)

    def point_cloud(self) -> NDArray[np.float64]:
        """Return the lidar points of the last scan, metres, map frame, shape (n, 3)."""
        self._loaded()
        return self._lidar.point_cloud()

    def drive_to(self, waypoint: tuple[float, float], watch: Watch | None = None) -> Leg:
        """Move along the straight segment to a waypoint; a wall on it stops the robot before it, a watch on its way."""
        robot, _ = self._loaded()
        leg = follow_segment(
            self._pose,
            waypoint,
            free_distance=self._free_distance,
            sense=self._scan_at,
            speed=self._config.speed,
            sense_every=self._config.sense_every,
            watch=watch,
        )
        if self.physics.gui:
            self._show(leg)
        self._pose = leg.pose
        robot.place(leg.pose)
        return leg

    def _scan_at(self, pose: Pose) -> Scan:
        robot, _ = self._loaded()
        if pose is not self._pose:
            robot.place(pose)
        return self._lidar.sense(self.physics.client, robot.body, robot.lidar)

    def _free_distance(self, pose: Pose, length: float) -> float:
        return free_distance(self.physics.client, pose, length, _COLLISION_HEIGHT)

    def _show(self, leg: Leg) -> None:
        """Move the robot through the window in real time."""
        robot, _ = self._loaded()
        frames = max(1, round(leg.duration / _FRAME))
        for k in range(1, frames + 1):
            part = k / frames
            x = self._pose.x + part * (leg.pose.x - self._pose.x)
            y = self._pose.y + part * (leg.pose.y - self._pose.y)
            pose = Pose(x, y, leg.pose.yaw)
            robot.place(pose)
            follow_with_camera(self.physics.client, pose)
            time.sleep(_FRAME)
