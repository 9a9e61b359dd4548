"""A 3D lidar and a planar one in worlds of walls, for the tests of the robot's mapping."""

from __future__ import annotations

import numpy as np

from common.geometry import Pose, Scan
from common.mapping.raycast import cast_rays, ray_angles
from deploy.config import DeployConfig

RESOLUTION = 0.25


def room(rows: int = 40, columns: int = 60) -> np.ndarray:
    """A closed room of 0.25 m cells with two pillars and a wall with a door: true where free."""
    free = np.ones((rows, columns), dtype=np.bool_)
    free[:2], free[-2:], free[:, :2], free[:, -2:] = False, False, False, False
    free[:, 36:38] = False
    free[16:26, 36:38] = True
    free[10:12, 12:14] = False
    free[28:31, 22:24] = False
    return free


def configure(**sections: dict[str, object]) -> DeployConfig:
    """A bridge's configuration for `room`, of a robot without size unless it is asked for."""
    values: dict[str, dict[str, object]] = {
        "mapping": {"resolution": RESOLUTION, "viewpoint_spacing": 1.0, "sensor_range": 12.0, "robot_radius": 0.0},
        "sensing": {},
    }
    for name, section in sections.items():
        values[name] = values.get(name, {}) | section
    return DeployConfig.model_validate(values)


def scan_at(
    free: np.ndarray,
    pose: Pose,
    *,
    origin: tuple[float, float] = (0.0, 0.0),
    resolution: float = RESOLUTION,
    range_max: float = 12.0,
    beams: int = 720,
    noise: float = 0.0,
    rng: np.random.Generator | None = None,
) -> Scan:
    """What a planar lidar measures there; the scan begins behind the robot."""
    step = 2.0 * np.pi / beams
    angles = ray_angles(pose.yaw, -np.pi, step, beams)
    ranges = cast_rays(free, resolution, *origin, pose.x, pose.y, angles, range_max)
    if noise and rng is not None:
        ranges = (ranges + rng.normal(0.0, noise, beams)).astype(np.float32)
    return Scan(ranges, -np.pi, step, range_max, 0.1)


def cloud_at(
    free: np.ndarray,
    pose: Pose,
    *,
    origin: tuple[float, float] = (0.0, 0.0),
    resolution: float = RESOLUTION,
    height: float = 0.4,
    wall: float = 2.0,
    lines: int = 16,
    azimuths: int = 600,
    range_max: float = 30.0,
    frame: str = "map",
    floor: float = 0.0,
) -> np.ndarray:
    """The returns of a lidar of 16 lines between -15 and 15 degrees, from walls and floor, float32, shape (n, 3)."""
    angles = ray_angles(0.0, -np.pi + 1e-3, 2.0 * np.pi / azimuths, azimuths)
    ranges = cast_rays(free, resolution, *origin, pose.x, pose.y, angles, range_max).astype(np.float64)
    slope = np.tan(np.radians(np.linspace(-15.0, 15.0, lines)))[:, None]
    at_floor = np.where(slope < 0.0, height / -np.minimum(slope, -1e-9), np.inf)
    distance = np.minimum(ranges[None], at_floor)
    z = height + slope * distance
    returned = np.isfinite(distance) & (z <= wall) & (distance < range_max)
    yaw = 0.0 if frame == "map" else pose.yaw
    x, y = distance * np.cos(angles - yaw), distance * np.sin(angles - yaw)
    if frame == "map":
        x, y, z = x + pose.x, y + pose.y, z + floor
    else:
        z = z - height
    return np.stack([x[returned], y[returned], z[returned]], axis=1).astype(np.float32)
