"""The differential-drive robot of the physics world: `robot.urdf`, its wheel motors and its pose."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from actors.simulators.bullet import pybullet
from actors.simulators.physics_world import PhysicsWorld
from common.errors import SimulatorError
from common.geometry import Pose

URDF = Path(__file__).with_name("robot.urdf")
# Round wheels instead of hulls with corners, and the inertia that the file states.
_LOADING = pybullet.URDF_USE_IMPLICIT_CYLINDER | pybullet.URDF_USE_INERTIA_FROM_FILE
_MOTOR_TORQUE = 10.0  # newton metres per wheel: twice what full acceleration needs


class Robot:
    """One robot in a physics world.

    Attributes:
        body: PyBullet's body number.
        lidar: link number of the lidar.
        wheel_radius: metres.
        track: distance between the wheels, metres.
        radius: of the round body, metres.
    """

    def __init__(self, world: PhysicsWorld, pose: Pose, *, collides: bool) -> None:
        """Load the robot at a pose.

        Args:
            world: a loaded physics world.
            pose: map frame.
            collides: False for a robot that is carried: it then touches nothing.
        """
        self._client = world.client
        self.body: int = pybullet.loadURDF(
            str(URDF),
            (pose.x, pose.y, 0.0),
            _quaternion(pose.yaw),
            flags=_LOADING if world.visible else _LOADING | pybullet.URDF_IGNORE_VISUAL_SHAPES,
            physicsClientId=self._client,
        )
        joints = {
            info[12].decode(): info
            for info in (
                pybullet.getJointInfo(self.body, index, physicsClientId=self._client)
                for index in range(pybullet.getNumJoints(self.body, physicsClientId=self._client))
            )
        }
        self._left, self._right = joints["left_wheel"][0], joints["right_wheel"][0]
        self.lidar: int = joints["lidar"][0]
        self.track = float(joints["left_wheel"][14][1] - joints["right_wheel"][14][1])
        self.wheel_radius = self._cylinder_radius(self._left)
        self.radius = self._cylinder_radius(-1)
        # The base frame of PyBullet is the centre of mass, which lies straight above the origin of the URDF.
        dynamics = pybullet.getDynamicsInfo(self.body, -1, physicsClientId=self._client)
        self._centre_height = float(dynamics[3][2])
        self._lidar_above_centre = float(joints["lidar"][14][2])
        for link in (-1, self._left, self._right, self.lidar):
            if not collides:
                pybullet.setCollisionFilterGroupMask(self.body, link, 0, 0, physicsClientId=self._client)
            else:
                pybullet.changeDynamics(
                    self.body, link, linearDamping=0.0, angularDamping=0.0, physicsClientId=self._client
                )
        if collides:
            # The wheels lie within the round body: only that may touch walls.
            for walls in world.walls:
                for link in (self._left, self._right):
                    pybullet.setCollisionFilterPair(self.body, walls, link, -1, 0, physicsClientId=self._client)
        self.command(0.0, 0.0)

    @property
    def lidar_height(self) -> float:
        """Height of the lidar above the floor, metres."""
        return self._centre_height + self._lidar_above_centre

    @property
    def pose(self) -> Pose:
        """Where the robot stands, map frame."""
        return self.state()[0]

    def state(self) -> tuple[Pose, float, float]:
        """Return the pose, the height of the robot above the floor (metres) and its tilt (radians).

        The pose is that of the point of the floor below the lidar.
        """
        (x, y, z), (qx, qy, qz, qw) = pybullet.getBasePositionAndOrientation(self.body, physicsClientId=self._client)
        yaw = math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
        upright = 1.0 - 2.0 * (qx * qx + qy * qy)
        tilt = math.acos(max(-1.0, min(1.0, upright)))
        # The lidar swings out when the body tilts; localisation by lidar follows it, and so does the pose.
        lean_x, lean_y = 2.0 * (qx * qz + qw * qy), 2.0 * (qy * qz - qw * qx)
        x += self._lidar_above_centre * lean_x
        y += self._lidar_above_centre * lean_y
        return Pose(x, y, yaw), z - self._centre_height, tilt

    def place(self, pose: Pose) -> None:
        """Put the robot at a pose, at rest."""
        pybullet.resetBasePositionAndOrientation(
            self.body,
            (pose.x, pose.y, self._centre_height),
            _quaternion(pose.yaw),
            physicsClientId=self._client,
        )
        pybullet.resetBaseVelocity(self.body, (0, 0, 0), (0, 0, 0), physicsClientId=self._client)
        for wheel in (self._left, self._right):
            pybullet.resetJointState(self.body, wheel, 0.0, 0.0, physicsClientId=self._client)
        self.command(0.0, 0.0)

    def command(self, speed: float, turn_rate: float) -> None:
        """Set the wheel motors' target velocities from a body velocity, m/s and rad/s."""
        half = 0.5 * self.track * turn_rate
        pybullet.setJointMotorControlArray(
            self.body,
            (self._left, self._right),
            pybullet.VELOCITY_CONTROL,
            targetVelocities=((speed - half) / self.wheel_radius, (speed + half) / self.wheel_radius),
            forces=(_MOTOR_TORQUE, _MOTOR_TORQUE),
            physicsClientId=self._client,
        )

    def velocity(self) -> tuple[float, float]:
        """Return the speed over ground (m/s, not negative) and the turn rate (rad/s)."""
        linear, angular = pybullet.getBaseVelocity(self.body, physicsClientId=self._client)
        return math.hypot(linear[0], linear[1]), float(angular[2])

    def touches(self, bodies: Sequence[int]) -> bool:
        """Whether the robot touches one of the bodies now."""
        return any(
            contact[8] <= 0.0
            for other in bodies
            for contact in pybullet.getContactPoints(self.body, other, physicsClientId=self._client) or ()
        )

    def _cylinder_radius(self, link: int) -> float:
        shapes: Any = pybullet.getCollisionShapeData(self.body, link, physicsClientId=self._client)
        for shape in shapes:
            if shape[2] == pybullet.GEOM_CYLINDER:
                return float(shape[3][1])
        raise SimulatorError(f"{URDF.name}: expected a cylinder as collision shape of link {link}")


def _quaternion(yaw: float) -> tuple[float, float, float, float]:
    return 0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)
