"""Messages to arrays and poses, and back."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose, Scan
from deploy.ros2.clouds import cloud_note as cloud_note  # noqa: PLC0414  (exported from here too)
from deploy.ros2.clouds import point_cloud as point_cloud  # noqa: PLC0414
from deploy.ros2.clouds import points_from as points_from  # noqa: PLC0414
from deploy.ros2.errors import RosError
from deploy.ros2.messages import Message, header, message, seconds, stamp

Position = tuple[float, float]
Quaternion = tuple[float, float, float, float]
Transform = tuple[float, str, str, tuple[float, float, float], Quaternion]
"""Time (s), parent frame, child frame, translation (m), rotation (x, y, z, w)."""

MAX_CELLS = 1 << 26
"""Larger occupancy grids are refused."""
MAX_COORDINATE = 1e8
"""Positions farther from their frame's origin are refused, metres: more than UTM coordinates ever are."""
MAX_VELOCITY = 1e3
"""Greater velocities are refused, m/s and rad/s."""
MAX_BEAMS = 1 << 17
"""Scans of more beams are refused."""
MAX_ANGLE = 4.0 * math.pi
"""Greater angles of a scan are refused, radians: they are degrees."""
RESOLUTIONS = (1e-3, 1e2)
"""Smallest and largest cell of an occupancy grid, metres."""
NEAREST_LIMIT = 10.0
"""A scan with a greater range_min is refused, metres: it is in millimetres."""
LENGTH_TOLERANCE = 0.1
"""A quaternion whose length is off from 1 by more is no rotation that was rounded, but a mistake, as in TF."""


def scan_from(scan: Message) -> Scan:
    """Return the ranges of a LaserScan, without a copy where they are float32 already.

    A range_max of infinity, which pointcloud_to_laserscan sends where no limit is set, is the largest float32.

    Raises:
        RosError: when the angles or ranges are not finite or not increasing limits, angles are in degrees, limits in
            millimetres, or there are too many beams.
    """
    range_max = min(scan.range_max, float(np.finfo(np.float32).max))
    numbers = (scan.angle_min, scan.angle_increment, scan.range_min, range_max)
    if not all(math.isfinite(number) for number in numbers) or scan.angle_increment == 0.0:
        raise RosError(f"a LaserScan needs finite angles and range limits and an increment, got {numbers}")
    if not 0.0 <= scan.range_min < range_max:
        raise RosError(f"a LaserScan's range_min {scan.range_min} must be below its range_max {scan.range_max}")
    if scan.range_min > NEAREST_LIMIT:
        raise RosError(
            f"a LaserScan's ranges must be metres, got range_min {scan.range_min:g} and range_max "
            f"{scan.range_max:g}: are they millimetres?"
        )
    if max(abs(scan.angle_min), abs(scan.angle_increment)) > MAX_ANGLE:
        raise RosError(
            f"a LaserScan's angles must be radians, got angle_min {scan.angle_min:g} and angle_increment "
            f"{scan.angle_increment:g}: are they degrees?"
        )
    if len(scan.ranges) > MAX_BEAMS:
        raise RosError(f"a LaserScan must have at most {MAX_BEAMS} beams, got {len(scan.ranges)}")
    ranges = np.asarray(scan.ranges, np.float32)
    return Scan(ranges, scan.angle_min, scan.angle_increment, range_max, scan.range_min)


def scan_note(scan: Message) -> str:
    """Return what is strange about a LaserScan that can be used all the same, one line; empty when nothing is."""
    if len(scan.intensities) not in {0, len(scan.ranges)}:
        return f"a LaserScan of {len(scan.ranges)} ranges has {len(scan.intensities)} intensities: correct the driver"
    return ""


def laser_scan(time: float, frame: str, scan: Scan, scan_time: float = 0.0) -> Message:
    """Build a LaserScan; angle_max is the last beam's angle.

    Args:
        time: stamp, seconds.
        frame: frame of the lidar.
        scan: ranges and angles.
        scan_time: seconds between scans.
    """
    return message(
        "sensor_msgs/msg/LaserScan",
        header=header(time, frame),
        angle_min=scan.angle_min,
        angle_max=scan.angle_min + max(len(scan.ranges) - 1, 0) * scan.angle_increment,
        angle_increment=scan.angle_increment,
        scan_time=scan_time,
        range_min=scan.range_min,
        range_max=scan.range_max,
        ranges=scan.ranges,
    )


def yaw_of(rotation: Message) -> float:
    """Return the yaw of a Quaternion message, radians.

    Raises:
        RosError: when it is no rotation: not finite, or its length is off from 1 by more than `LENGTH_TOLERANCE`.
    """
    x, y, z, w = rotation.x, rotation.y, rotation.z, rotation.w
    norm = x * x + y * y + z * z + w * w
    # Written so that NaN is not within.
    if not abs(math.sqrt(norm) - 1.0) <= LENGTH_TOLERANCE:
        raise RosError(
            f"a rotation must be a quaternion of length 1, got ({x}, {y}, {z}, {w}): a yaw in radians is "
            "(0, 0, sin(yaw / 2), cos(yaw / 2))"
        )
    return math.atan2(2.0 * (w * z + x * y), norm - 2.0 * (y * y + z * z))


def quaternion(yaw: float) -> Message:
    """Build a Quaternion that turns about z, radians."""
    return message("geometry_msgs/msg/Quaternion", z=math.sin(yaw / 2.0), w=math.cos(yaw / 2.0))


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
    return seconds(odometry.header.stamp), _pose(odometry.pose.pose), velocity


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


def position_from(stamped: Message) -> tuple[float, Position]:
    """Return stamp (s) and (x, y) in metres of a PointStamped.

    Raises:
        RosError: when the point is not finite.
    """
    x, y = stamped.point.x, stamped.point.y
    _check_metres("a point", x, y)
    return seconds(stamped.header.stamp), (x, y)


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


def transforms_from(transforms: Message) -> list[Transform]:
    """Return the transforms of a TFMessage as they are; `deploy.mapping.transforms` looks whether each of them is one.

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


def grid_from(grid: Message) -> tuple[NDArray[np.int8], float, tuple[float, float, float]]:
    """Return the cells (rows, columns) of an OccupancyGrid, metres per cell, and x, y, yaw of cell (0, 0)'s corner.

    The origin's rotation may be left out (0, 0, 0, 0): then the map is not turned, as for RViz and nav2.

    Raises:
        RosError: when the size does not fit the cells, the resolution is not positive, or the origin is no pose.
    """
    info = grid.info
    if not RESOLUTIONS[0] <= info.resolution <= RESOLUTIONS[1]:
        raise RosError(
            f"an OccupancyGrid's resolution must be positive, {RESOLUTIONS[0]:g} to {RESOLUTIONS[1]:g} metres, got "
            f"{info.resolution}"
        )
    if info.width * info.height != len(grid.data) or len(grid.data) > MAX_CELLS:
        raise RosError(
            f"an OccupancyGrid of {info.width} x {info.height} cells (at most {MAX_CELLS}) has {len(grid.data)} cells"
        )
    corner = _pose(info.origin, may_be_unset=True)
    cells = np.asarray(grid.data, np.int8).reshape(info.height, info.width)
    return cells, info.resolution, (corner.x, corner.y, corner.yaw)


def occupancy_grid(
    time: float,
    frame: str,
    cells: NDArray[np.int8],
    resolution: float,
    origin: tuple[float, float, float] | Position = (0.0, 0.0, 0.0),
) -> Message:
    """Build an OccupancyGrid.

    Args:
        time: stamp, seconds.
        frame: frame of the map.
        cells: -1 unknown, 0 free to 100 occupied, shape (rows, columns); row 0 is lowest in y.
        resolution: metres per cell.
        origin: x, y in metres and perhaps yaw of the corner of cell (0, 0).
    """
    rows, columns = cells.shape
    return message(
        "nav_msgs/msg/OccupancyGrid",
        header=header(time, frame),
        info=message(
            "nav_msgs/msg/MapMetaData",
            map_load_time=stamp(time),
            resolution=resolution,
            width=columns,
            height=rows,
            origin=pose_message(Pose(*origin)),
        ),
        data=np.ascontiguousarray(cells, np.int8).reshape(-1),
    )


def pose_message(pose: Pose, z: float = 0.0) -> Message:
    """Build a Pose; z in metres."""
    return message(
        "geometry_msgs/msg/Pose",
        position=message("geometry_msgs/msg/Point", x=pose.x, y=pose.y, z=z),
        orientation=quaternion(pose.yaw),
    )


def point_stamped(time: float, frame: str, position: Position, z: float = 0.0) -> Message:
    """Build a PointStamped from (x, y) and z in metres."""
    point = message("geometry_msgs/msg/Point", x=position[0], y=position[1], z=z)
    return message("geometry_msgs/msg/PointStamped", header=header(time, frame), point=point)


def pose_stamped(time: float, frame: str, pose: Pose, z: float = 0.0) -> Message:
    """Build a PoseStamped; z in metres."""
    return message("geometry_msgs/msg/PoseStamped", header=header(time, frame), pose=pose_message(pose, z))


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


def path_from(route: Message) -> list[Position]:
    """Return the (x, y) positions of a Path, metres."""
    return [(stamped.pose.position.x, stamped.pose.position.y) for stamped in route.poses]


def twist(linear: float, angular: float) -> Message:
    """Build a Twist: forwards m/s, turning rad/s."""
    return message(
        "geometry_msgs/msg/Twist",
        linear=message("geometry_msgs/msg/Vector3", x=linear),
        angular=message("geometry_msgs/msg/Vector3", z=angular),
    )


def twist_stamped(time: float, frame: str, linear: float, angular: float) -> Message:
    """Build a TwistStamped: forwards m/s, turning rad/s."""
    return message("geometry_msgs/msg/TwistStamped", header=header(time, frame), twist=twist(linear, angular))


def velocity_from(command: Message) -> tuple[float, float]:
    """Return (forwards m/s, turning rad/s) of a Twist or TwistStamped.

    Raises:
        RosError: when they are not finite.
    """
    inner: Message = getattr(command, "twist", command)
    linear, angular = inner.linear.x, inner.angular.z
    if not (math.isfinite(linear) and math.isfinite(angular)):
        raise RosError(f"a velocity must be finite, got ({linear}, {angular})")
    return linear, angular


def _pose(pose: Message, *, may_be_unset: bool = False) -> Pose:
    x, y = pose.position.x, pose.position.y
    _check_metres("a position", x, y, pose.position.z)
    turn = pose.orientation
    if may_be_unset and (turn.x, turn.y, turn.z, turn.w) == (0.0, 0.0, 0.0, 0.0):
        return Pose(x, y, 0.0)
    return Pose(x, y, yaw_of(turn))


def _check_metres(what: str, *numbers: float) -> None:
    # Written so that NaN is not within.
    if not all(abs(number) <= MAX_COORDINATE for number in numbers):
        raise RosError(f"{what} must be finite metres of at most {MAX_COORDINATE:g}, got {numbers}")
