"""The `pybullet` simulator in dynamic fidelity: wheels, motors, contacts, and a lidar that scans on the way."""

from __future__ import annotations

import logging
import math

import numpy as np
from numpy.typing import NDArray

from actors.maps.grid_map import GridMap
from actors.simulators.base import Leg, Watch
from actors.simulators.bullet import pybullet
from actors.simulators.clearance import nearest_clear
from actors.simulators.grid import check_free
from actors.simulators.physics_simulator import PhysicsSimulator
from actors.simulators.physics_world import TIME_STEP
from actors.simulators.robot import Robot
from actors.simulators.segment import check_waypoint
from actors.simulators.tracking import DriveLimits, SegmentTracker
from actors.simulators.view import RealTime, follow_with_camera
from common.config import SimulatorConfig
from common.errors import SimulatorError
from common.geometry import Pose, Scan

_log = logging.getLogger(__name__)

_STEPS_PER_COMMAND = 4
CONTROL_INTERVAL = _STEPS_PER_COMMAND * TIME_STEP
"""Simulated seconds between two commands to the wheel motors."""
_SOLVER_ITERATIONS = 20
_SETTLING_TIME = 0.1
_CONTACT_GAP = 0.25  # seconds without contact after which a touch is a new collision
_STUCK_TIME, _STUCK_DISTANCE = 1.5, 0.05
_BACK_OFF_SPEED, _BACK_OFF_DISTANCE = 0.4, 0.3
_STANDING_SPEED, _STANDING_TURN = 0.02, 0.05
_MARGIN = 0.03
_LARGEST_TILT = math.radians(25.0)
_LARGEST_RISE = 0.1


class DynamicSimulator(PhysicsSimulator):
    """A differential-drive robot under physics at 240 Hz, driven by a tracking controller at 60 Hz.

    While it drives, the lidar scans at ``lidar_rate``, at most 60 Hz; ``sense_every`` belongs to the other simulators
    and has no effect.
    """

    def __init__(
        self, config: SimulatorConfig, sensor_range: float, *, gui: bool = False, visible: bool = False
    ) -> None:
        """Open a physics server.

        Args:
            config: sensor and speed.
            sensor_range: metres.
            gui: open PyBullet's window; simulated time then keeps pace with real time.
            visible: give the world colours, for rendering without a window.
        """
        super().__init__(config, sensor_range, gui=gui, visible=visible)
        self._limits = DriveLimits(speed=config.speed)
        self._clock = RealTime() if gui else None
        self._time = 0.0
        self._last_contact = -math.inf
        self._collisions = 0

    @property
    def pose(self) -> Pose:
        """Where the robot stands."""
        return self._loaded()[0].pose

    @property
    def time(self) -> float:
        """Simulated seconds since the simulator was made; a reset does not turn it back."""
        return self._time

    @property
    def collisions(self) -> int:
        """Contacts with the world that began since the last `reset`, `place` or begin of `drive_to`."""
        return self._collisions

    @property
    def lidar_height(self) -> float:
        """Height of the lidar above the floor, metres."""
        return self._loaded()[0].lidar_height

    def reset(self, world: GridMap, seed: int) -> Pose:
        """Load a world, put the robot on its start and return its pose.

        The robot faces along x. Where the start is nearer to a wall than the robot's radius, it stands on the
        nearest place that has room for it.
        """
        self._load(world, seed)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=CONTROL_INTERVAL,
            numSubSteps=_STEPS_PER_COMMAND,
            numSolverIterations=_SOLVER_ITERATIONS,
            physicsClientId=self.physics.client,
        )
        self._robot = Robot(self.physics, Pose(*world.start), collides=True)
        self.place(Pose(*world.start))
        if self.physics.gui:
            follow_with_camera(self.physics.client, self.pose, fresh=True)
        return self.pose

    def place(self, pose: Pose) -> None:
        """Put the robot somewhere else, at rest, on the nearest place with room for it.

        Raises:
            SimulatorError: the position is not in free space, or there is no room near it.
        """
        robot, world = self._loaded()
        x, y = nearest_clear(world, check_free(world, pose).position, robot.radius + _MARGIN)
        robot.place(Pose(x, y, pose.yaw))
        self._last_contact = -math.inf
        for _ in range(round(_SETTLING_TIME / CONTROL_INTERVAL)):
            self.advance(0.0, 0.0)
        self._collisions = 0

    def scan(self) -> Scan:
        """Scan from where the robot stands."""
        robot, _ = self._loaded()
        return self._lidar.sense(self.physics.client, robot.body, robot.lidar)

    def point_cloud(self, *, in_sensor: bool = False) -> NDArray[np.float64]:
        """Return the lidar points of the last scan, metres, map frame or the lidar's own, shape (n, 3)."""
        self._loaded()
        return self._lidar.point_cloud(in_sensor=in_sensor)

    def drive_to(self, waypoint: tuple[float, float], watch: Watch | None = None) -> Leg:
        """Drive along the straight segment to a waypoint and stop there, or on the way where the watch says so.

        The robot gives up when it has made no way for 1.5 s or when three times the usual duration is over; it then
        stops and backs off from the wall that it touches. It also has arrived when it can come no closer but
        stands over the waypoint, which lies nearer to a wall than its radius.

        Raises:
            SimulatorError: the robot tipped over or fell out of the world.
        """
        robot, _ = self._loaded()
        goal = check_waypoint(waypoint)
        pose = robot.pose
        tracker = SegmentTracker(pose, goal, self._limits)
        began, deadline = self._time, self._time + tracker.time_limit()
        next_scan = began + 1.0 / self._config.lidar_rate
        mark, marked = pose, began
        sensed: list[tuple[Pose, Scan]] = []
        travelled = 0.0
        self._collisions = 0
        stopped = False
        while not tracker.at_goal(pose) and self._time < deadline:
            before = pose
            pose = self.advance(*tracker.command(pose, CONTROL_INTERVAL))
            travelled += before.distance_to(pose.position)
            if self._time >= next_scan - 0.5 * TIME_STEP:
                scan = self.scan()
                next_scan += 1.0 / self._config.lidar_rate
                if watch is None:
                    sensed.append((pose, scan))
                elif watch(pose, scan):
                    stopped = True
                    break
            if mark.distance_to(pose.position) > _STUCK_DISTANCE or _turned(mark, pose) > 0.1:
                mark, marked = pose, self._time
            elif self._time - marked > _STUCK_TIME:
                break
        reached = tracker.at_goal(pose) or pose.distance_to(goal) <= robot.radius
        travelled += self._stop()
        if not (reached or stopped):
            travelled += self._back_off()
        return Leg(
            pose=robot.pose,
            distance=travelled,
            duration=self._time - began,
            reached=reached,
            collisions=self._collisions,
            sensed=sensed,
            stopped=stopped and not reached,
        )

    def advance(self, speed: float, turn_rate: float) -> Pose:
        """Drive for one `CONTROL_INTERVAL` and return the pose; `drive_to` is made of such steps.

        The wheel motors follow at once, up to their torque: whoever commands limits accelerations.

        Args:
            speed: forwards, m/s.
            turn_rate: counter-clockwise, rad/s.

        Raises:
            SimulatorError: the robot tipped over or fell out of the world.
        """
        robot, world = self._loaded()
        robot.command(speed, turn_rate)
        pybullet.stepSimulation(physicsClientId=self.physics.client)
        self._time += CONTROL_INTERVAL
        pose, height, tilt = robot.state()
        if not (abs(height) < _LARGEST_RISE and tilt < _LARGEST_TILT):
            raise SimulatorError(
                f"map {world.name!r}: the robot left the floor at ({pose.x:.2f}, {pose.y:.2f}): height {height:.2f} m, "
                f"tilt {math.degrees(tilt):.0f} degrees; reset the episode, and lower simulator.speed if it returns"
            )
        if robot.touches((*self.physics.walls, *self.physics.pillars)):
            if self._time - self._last_contact > _CONTACT_GAP:
                self._collisions += 1
            self._last_contact = self._time
        if self._clock is not None:
            self._clock.advance(CONTROL_INTERVAL)
            follow_with_camera(self.physics.client, pose)
        return pose

    def _stop(self) -> float:
        """Brake until the robot stands; return the distance that it took, metres."""
        robot, _ = self._loaded()
        pose = robot.pose
        travelled = 0.0
        for _ in range(round(1.0 / CONTROL_INTERVAL)):
            speed, turn_rate = robot.velocity()
            if speed < _STANDING_SPEED and abs(turn_rate) < _STANDING_TURN:
                break
            before = pose
            pose = self.advance(0.0, 0.0)
            travelled += before.distance_to(pose.position)
        return travelled

    def _back_off(self) -> float:
        """Reverse a little from the wall that holds the robot; return the distance, metres."""
        robot, _ = self._loaded()
        if self._time - self._last_contact > _CONTACT_GAP:
            return 0.0
        _log.debug("robot blocked at %s: backing off", robot.pose)
        pose = robot.pose
        travelled = 0.0
        for _ in range(round(_BACK_OFF_DISTANCE / _BACK_OFF_SPEED / CONTROL_INTERVAL)):
            before = pose
            pose = self.advance(-_BACK_OFF_SPEED, 0.0)
            travelled += before.distance_to(pose.position)
        return travelled + self._stop()


def _turned(before: Pose, after: Pose) -> float:
    return abs(math.remainder(after.yaw - before.yaw, 2.0 * math.pi))
