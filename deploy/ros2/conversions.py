"""Messages to arrays and poses, and back: the conversions of all kinds of messages, which have a module each."""

from __future__ import annotations

from deploy.ros2.clouds import (
    cloud_note,
    point_cloud,
    points_from,
)
from deploy.ros2.grids import (
    MAX_CELLS,
    RESOLUTIONS,
    grid_from,
    occupancy_grid,
)
from deploy.ros2.poses import (
    LENGTH_TOLERANCE,
    MAX_COORDINATE,
    MAX_VELOCITY,
    Position,
    Quaternion,
    Transform,
    odometry,
    path,
    path_from,
    point_stamped,
    pose_from,
    pose_from_stamped,
    pose_message,
    pose_stamped,
    position_from,
    quaternion,
    transform,
    transform_message,
    transforms_from,
    yaw_of,
)
from deploy.ros2.scans import (
    MAX_ANGLE,
    MAX_BEAMS,
    NEAREST_LIMIT,
    laser_scan,
    scan_from,
    scan_note,
)
from deploy.ros2.velocities import (
    twist,
    twist_stamped,
    velocity_from,
)

__all__ = [
    "LENGTH_TOLERANCE",
    "MAX_ANGLE",
    "MAX_BEAMS",
    "MAX_CELLS",
    "MAX_COORDINATE",
    "MAX_VELOCITY",
    "NEAREST_LIMIT",
    "RESOLUTIONS",
    "Position",
    "Quaternion",
    "Transform",
    "cloud_note",
    "grid_from",
    "laser_scan",
    "occupancy_grid",
    "odometry",
    "path",
    "path_from",
    "point_cloud",
    "point_stamped",
    "points_from",
    "pose_from",
    "pose_from_stamped",
    "pose_message",
    "pose_stamped",
    "position_from",
    "quaternion",
    "scan_from",
    "scan_note",
    "transform",
    "transform_message",
    "transforms_from",
    "twist",
    "twist_stamped",
    "velocity_from",
    "yaw_of",
]
