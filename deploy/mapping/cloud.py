"""Point clouds of a 3D lidar as beams in the plane: the nearest obstacle in each direction within a band of heights."""

from __future__ import annotations

from math import pi
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.errors import MappingError
from common.geometry import Pose
from common.system.jit import njit
from deploy.config import SensingConfig
from deploy.mapping.log_odds import Beams
from deploy.mapping.own_body import OwnBody, body_at
from deploy.tf.transform import Transform

FAR: Final = (50.0, 100.0)
"""Twentieth and median of the distances of a cloud's points from which on they are no metres."""
# Points of a cloud that are looked at for that.
_LOOKED_AT: Final = 500


@njit(cache=True, nogil=True)
def _project(
    points: NDArray[np.float32],
    rotation: NDArray[np.float64],
    offset_x: float,
    offset_y: float,
    offset_z: float,
    sensor_x: float,
    sensor_y: float,
    sensor_height: float,
    height_min: float,
    height_max: float,
    range_min: float,
    range_max: float,
    edges: NDArray[np.float64],
    reach: float,
    base_x: float,
    base_y: float,
    base_yaw: float,
    nearest: NDArray[np.float64],
    cleared: NDArray[np.float64],
) -> None:
    """Find per beam the nearest obstacle and how far the floor is seen; see `project`."""
    beams = len(nearest)
    per_radian = beams / (2.0 * np.pi)
    cosine, sine = np.cos(base_yaw), np.sin(base_yaw)
    base_x, base_y = base_x - sensor_x, base_y - sensor_y
    for n in range(len(points)):
        px, py, pz = np.float64(points[n, 0]), np.float64(points[n, 1]), np.float64(points[n, 2])
        height = rotation[2, 0] * px + rotation[2, 1] * py + rotation[2, 2] * pz + offset_z
        if not height <= height_max:
            continue
        x = rotation[0, 0] * px + rotation[0, 1] * py + rotation[0, 2] * pz + offset_x - sensor_x
        y = rotation[1, 0] * px + rotation[1, 1] * py + rotation[1, 2] * pz + offset_y - sensor_y
        distance = np.sqrt(x * x + y * y)
        if not (range_min <= distance < np.inf):
            continue
        away_x, away_y = x - base_x, y - base_y
        if body_at(edges, reach, cosine * away_x + sine * away_y, cosine * away_y - sine * away_x):
            continue
        beam = min(int((np.arctan2(y, x) + np.pi) * per_radian), beams - 1)
        if height >= height_min and distance < range_max:
            nearest[beam] = min(nearest[beam], distance)
            continue
        if height < 0.0 and sensor_height > 0.0:
            # The line of sight went below the floor's level there: what lies behind may be a drop.
            distance *= sensor_height / (sensor_height - height)
        cleared[beam] = max(cleared[beam], min(distance, range_max))


def checked_points(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a copy of points, float32, shape (n, 3).

    A copy is cheap, and messages are views of buffers that belong to others; kernels would be compiled anew for
    arrays that are read-only.

    Raises:
        MappingError: the shape is not (n, 3 or more).
    """
    if points.ndim != 2 or points.shape[1] < 3:
        raise MappingError(f"a point cloud must have the shape (n, 3 or more), got {points.shape}: drop this cloud")
    return np.array(points[:, :3], dtype=np.float32, order="C")


def project(
    points: NDArray[np.float32],
    map_from_points: Transform,
    sensor: tuple[float, float, float],
    floor: float,
    config: SensingConfig,
    range_max: float,
    body: OwnBody,
    base: Pose,
) -> Beams:
    """Turn a point cloud into beams in the plane, whose directions are those of the map frame (yaw 0).

    What a beam tells is decided so:

    - the nearest point within the band of heights, if there is one, is an obstacle, and before it the beam is free;
    - else the beam is free up to the farthest point on the floor, because the lidar saw the floor there; where a point
      lies below the floor, up to where the line of sight went through the floor's level;
    - points within the robot's outline, whatever their height, are the robot itself, and tell nothing;
    - points above the band tell nothing, because the line of sight left the band on its way;
    - a direction without any point tells nothing: a cloud does not say whether the lidar looked there.

    Args:
        points: float32, shape (n, 3 or more), metres; points with NaN are no returns.
        map_from_points: where the frame of the points lies in the map frame.
        sensor: x, y, z of the lidar in the map frame, metres.
        floor: height of the floor below the robot in the map frame, metres.
        config: band of heights, ``range_min``, number of beams.
        range_max: points beyond it count as nothing met, metres in the plane.
        body: outline of the robot.
        base: of the robot, map frame.
    """
    nearest = np.full(config.beams, np.inf)
    cleared = np.full(config.beams, -np.inf)
    _project(
        points,
        map_from_points.matrix(),
        map_from_points.translation[0],
        map_from_points.translation[1],
        map_from_points.translation[2] - floor,
        sensor[0],
        sensor[1],
        sensor[2] - floor,
        config.height_min,
        config.height_max,
        config.range_min,
        range_max,
        body.edges,
        body.reach,
        base.x,
        base.y,
        base.yaw,
        nearest,
        cleared,
    )
    hits = np.isfinite(nearest)
    ranges = np.where(hits, nearest, np.where(cleared > 0.0, cleared, np.nan))
    width = 2.0 * pi / config.beams
    angles = -pi + width * (np.arange(config.beams, dtype=np.float64) + 0.5)
    return Beams(ranges.astype(np.float32), hits, angles)


def problem(
    points: NDArray[np.float32],
    map_from_points: Transform,
    sensor: tuple[float, float, float],
    floor: float,
    height: float,
) -> tuple[str, str]:
    """Look whether the points of a cloud can be metres, and whether any is low enough to count.

    Args:
        points: as for `project`.
        map_from_points: likewise.
        sensor: likewise.
        floor: likewise.
        height: that up to which points count, metres above the floor.

    Returns:
        What is wrong in a word or two and in a sentence; both empty when nothing is.
    """
    some = points[:: len(points) // _LOOKED_AT + 1, :3]
    some = some[np.isfinite(some).all(axis=1)]
    if len(some) == 0:
        return "", ""
    placed = map_from_points.apply(some.astype(np.float64))
    distances = np.hypot(placed[:, 0] - sensor[0], placed[:, 1] - sensor[1])
    near, median = (float(number) for number in np.quantile(distances, (0.05, 0.5)))
    if near > FAR[0] and median > FAR[1]:
        return "cloud too far", (
            f"the points of a cloud must be metres in the frame of its header: half of {len(points)} points are more "
            f"than {median:.0f} m from the lidar: are they millimetres, or in another frame?"
        )
    lowest = float(placed[:, 2].min()) - floor
    if lowest > height:
        return "cloud too high", (
            f"the lowest point of a cloud is {lowest:.1f} m above the floor, and only points up to sensing.height_max "
            f"({height:g} m) count: check sensing.sensor_height, and the height of the cloud's frame"
        )
    return "", ""
