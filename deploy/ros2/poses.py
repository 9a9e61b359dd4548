"""Messages of places to poses and positions, and back: Odometry, goals, paths and transforms."""

from __future__ import annotations

import math
from collections.abc import Sequence

from common.geometry import Pose
from deploy.ros2.errors import RosError
from deploy.ros2.messages import Message, header, message, seconds
from deploy.ros2.velocities import twist

Position = tuple[float, float]
Quaternion = tuple[float, float, float, float]
Transform = tuple[float, str, str, tuple[float, float, float], Quaternion]
"""Time (s), parent frame, child frame, translation (m), rotation (x, y, z, w)."""

MAX_COORDINATE = 1e8
"""Positions farther from their frame's origin are refused, metres: more than UTM coordinates ever are."""
MAX_VELOCITY = 1e3
"""Greater velocities are refused, m/s and rad/s."""
LENGTH_TOLERANCE = 0.1
"""A quaternion whose length is off from 1 by more is no rotation that was rounded, but a mistake, as in TF."""


def pose_from(odometry: Message) -> tuple[float, Pose, tuple[float, float]]:
    """Return stamp (s), pose, and (linear x m/s, angular z rad/s) of an Odometry.

    Raises:
        RosError: when the pose or the velocity is not finite, or beyond reason.
    """
    velocity = odometry.twist.twist.linear.x, odometry.twist.twist.angular.z
    # Written so that NaN is not within.
    if not all(abs(value) <= MAX_VELOCITY for value in velocity):
        raise RosError(
            f"an Odometry's velocity must be finite, m/s and rad/s of at most {MAX_VELOCITY:g}, got {velocity}"
        )
    return seconds(odometry.header.stamp), pose_of(odometry.pose.pose), velocity


def odometry(
    time: float, frame: str, child: str, pose: Pose, velocity: tuple[float, float] = (0.0, 0.0), z: float = 0.0
) -> Message:
    """Build an Odometry.

    Args:
        time: stamp, seconds.
        frame: frame of the pose.
        child: frame of the velocity, the robot's own.
        pose: metres and radians.
        velocity: forwards m/s, turning rad/s.
        z: height, metres.
    """
    return message(
        "nav_msgs/msg/Odometry",
        header=header(time, frame),
        child_frame_id=child,
        pose=message("geometry_msgs/msg/PoseWithCovariance", pose=pose_message(pose, z)),
        twist=message("geometry_msgs/msg/TwistWithCovariance", twist=twist(*velocity)),
    )


def pose_from_stamped(stamped: Message) -> tuple[float, Pose]:
    """Return stamp (s) and pose of a PoseStamped that is a goal.

    A goal is a place: where its rotation is none, left out (0, 0, 0, 0) or not of length 1, the yaw is 0.

    Raises:
        RosError: when the position is not finite.
    """
    position = stamped.pose.position
    _check_metres("a position", position.x, position.y, position.z)
    try:
        yaw = yaw_of(stamped.pose.orientation)
    except RosError:
        yaw = 0.0
    return seconds(stamped.header.stamp), Pose(position.x, position.y, yaw)


def pose_stamped(time: float, frame: str, pose: Pose, z: float = 0.0) -> Message:
    """Build a PoseStamped; z in metres."""
    return message("geometry_msgs/msg/PoseStamped", header=header(time, frame), pose=pose_message(pose, z))


def position_from(stamped: Message) -> tuple[float, Position]:
    """Return stamp (s) and (x, y) in metres of a PointStamped.

    Raises:
        RosError: when the point is not finite.
    """
    x, y = stamped.point.x, stamped.point.y
    _check_metres("a point", x, y)
    return seconds(stamped.header.stamp), (x, y)


def point_stamped(time: float, frame: str, position: Position, z: float = 0.0) -> Message:
    """Build a PointStamped from (x, y) and z in metres."""
    point = message("geometry_msgs/msg/Point", x=position[0], y=position[1], z=z)
    return message("geometry_msgs/msg/PointStamped", header=header(time, frame), point=point)


def path_from(route: Message) -> list[Position]:
    """Return the (x, y) positions of a Path, metres."""
    return [(stamped.pose.position.x, stamped.pose.position.y) for stamped in route.poses]


def path(time: float, frame: str, positions: Sequence[Position], z: float = 0.0) -> Message:
    """Build a Path through positions in metres; each pose looks towards the next."""
    head = header(time, frame)
    poses = []
    yaw = 0.0
    for number, (x, y) in enumerate(positions):
        if number + 1 < len(positions):
            yaw = math.atan2(positions[number + 1][1] - y, positions[number + 1][0] - x)
        poses.append(message("geometry_msgs/msg/PoseStamped", header=head, pose=pose_message(Pose(x, y, yaw), z)))
    return message("nav_msgs/msg/Path", header=head, poses=poses)


def transforms_from(transforms: Message) -> list[Transform]:
    """Return the transforms of a TFMessage as they are; `deploy.tf.transforms` looks whether each of them is one.

    A message carries those of several publishers' frames: one that is wrong must not hide the others.
    """
    result: list[Transform] = []
    for one in transforms.transforms:
        move, turn = one.transform.translation, one.transform.rotation
        shift = (move.x, move.y, move.z)
        rotation = (turn.x, turn.y, turn.z, turn.w)
        parent, child = one.header.frame_id.lstrip("/"), one.child_frame_id.lstrip("/")
        result.append((seconds(one.header.stamp), parent, child, shift, rotation))
    return result


def transform(time: float, parent: str, child: str, pose: Pose, z: float = 0.0) -> Message:
    """Build a TransformStamped of the child frame's pose in the parent frame; z in metres."""
    return message(
        "geometry_msgs/msg/TransformStamped",
        header=header(time, parent),
        child_frame_id=child,
        transform=message(
            "geometry_msgs/msg/Transform",
            translation=message("geometry_msgs/msg/Vector3", x=pose.x, y=pose.y, z=z),
            rotation=quaternion(pose.yaw),
        ),
    )


def transform_message(transforms: Sequence[Message]) -> Message:
    """Build a TFMessage of TransformStamped messages."""
    return message("tf2_msgs/msg/TFMessage", transforms=list(transforms))


def pose_message(pose: Pose, z: float = 0.0) -> Message:
    """Build a Pose; z in metres."""
    return message(
        "geometry_msgs/msg/Pose",
        position=message("geometry_msgs/msg/Point", x=pose.x, y=pose.y, z=z),
        orientation=quaternion(pose.yaw),
    )


def pose_of(pose: Message, *, may_be_unset: bool = False) -> Pose:
    """Return a Pose message's position in the plane, metres, and yaw, radians.

    Args:
        pose: the message.
        may_be_unset: a rotation that was left out, (0, 0, 0, 0), is none.

    Raises:
        RosError: when the position is not finite or beyond reason, or the rotation is none.
    """
    x, y = pose.position.x, pose.position.y
    _check_metres("a position", x, y, pose.position.z)
    turn = pose.orientation
    if may_be_unset and (turn.x, turn.y, turn.z, turn.w) == (0.0, 0.0, 0.0, 0.0):
        return Pose(x, y, 0.0)
    return Pose(x, y, yaw_of(turn))


def yaw_of(rotation: Message) -> float:
    """Return the yaw of a Quaternion message, radians.

    Raises:
        RosError: when it is no rotation: not finite, or its length is off from 1 by more than `LENGTH_TOLERANCE`; or
            it turns the z axis below the horizon.
    """
    x, y, z, w = rotation.x, rotation.y, rotation.z, rotation.w
    norm = x * x + y * y + z * z + w * w
    # Written so that NaN is not within.
    if not abs(math.sqrt(norm) - 1.0) <= LENGTH_TOLERANCE:
        raise RosError(
            f"a rotation must be a quaternion of length 1, got ({x}, {y}, {z}, {w}): a yaw in radians is "
            "(0, 0, sin(yaw / 2), cos(yaw / 2))"
        )
    if x * x + y * y > z * z + w * w:
        raise RosError(
            f"the z axis of a pose must point up, but ({x}, {y}, {z}, {w}) turns it down, so left and right would be "
            "exchanged: is the frame NED (z down) instead of ENU (z up)?"
        )
    return math.atan2(2.0 * (w * z + x * y), norm - 2.0 * (y * y + z * z))


def quaternion(yaw: float) -> Message:
    """Build a Quaternion that turns about z, radians."""
    return message("geometry_msgs/msg/Quaternion", z=math.sin(yaw / 2.0), w=math.cos(yaw / 2.0))


def _check_metres(what: str, *numbers: float) -> None:
    # Written so that NaN is not within.
    if not all(abs(number) <= MAX_COORDINATE for number in numbers):
        raise RosError(f"{what} must be finite metres of at most {MAX_COORDINATE:g}, got {numbers}")
