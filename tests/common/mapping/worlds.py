"""Small worlds and scans for the tests of the mapping."""

from __future__ import annotations

import numpy as np

from common.config import MappingConfig
from common.geometry import Pose, Scan
from common.mapping.mapper import Mapper
from common.mapping.raycast import cast_rays, ray_angles
from tests.common.mapping.reference import full_turn


def world_of(text: str) -> np.ndarray:
    """A true map drawn with `#` for walls, its top row first."""
    return np.array([[character != "#" for character in line] for line in text.split()[::-1]])


def random_world(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    """Rooms, walls with doors and clutter: true where free."""
    free = np.ones((rows, columns), dtype=np.bool_)
    free[[0, -1], :] = False
    free[:, [0, -1]] = False
    for _ in range(rng.integers(0, 4)):
        column = int(rng.integers(2, columns - 2))
        free[:, column : column + int(rng.integers(1, 3))] = False
        door = int(rng.integers(1, rows - 6))
        free[door : door + int(rng.integers(1, 7)), column : column + 2] = True
    for _ in range(rng.integers(0, 4)):
        row = int(rng.integers(2, rows - 2))
        free[row : row + int(rng.integers(1, 3)), :] = False
        door = int(rng.integers(1, columns - 6))
        free[row : row + 2, door : door + int(rng.integers(1, 7))] = True
    for _ in range(rng.integers(0, 12)):
        row, column = int(rng.integers(1, rows - 1)), int(rng.integers(1, columns - 1))
        free[row : row + int(rng.integers(1, 4)), column : column + int(rng.integers(1, 4))] = False
    return free


def scan_of(
    free: np.ndarray,
    resolution: float,
    origin: tuple[float, float],
    pose: Pose,
    *,
    range_max: float = 8.0,
    beams: int = 120,
) -> Scan:
    angles = ray_angles(pose.yaw, -np.pi, full_turn(beams), beams)
    ranges = cast_rays(free, resolution, origin[0], origin[1], pose.x, pose.y, angles, range_max)
    return Scan(ranges, -np.pi, full_turn(beams), range_max)


def see(mapper: Mapper, free: np.ndarray, pose: Pose, *, beams: int = 720) -> None:
    """Scan a world whose lower left corner is (0, 0), and update."""
    config = mapper._config
    mapper.integrate(
        scan_of(free, config.resolution, (0.0, 0.0), pose, range_max=config.sensor_range, beams=beams), pose
    )
    mapper.update(pose)


def see_all(mapper: Mapper, free: np.ndarray, pose: Pose) -> None:
    """Know a whole world at once, whose lower left corner is (0, 0)."""
    mapper.belief.assign(np.where(free, 0, 100).astype(np.int8), (0.0, 0.0))
    mapper.update(pose)


def small_config(**changes: float) -> MappingConfig:
    values: dict[str, float] = {
        "resolution": 0.5,
        "sensor_range": 10.0,
        "viewpoint_spacing": 2.0,
        "beacon_range": 6.0,
    }
    return MappingConfig(**{**values, **changes})
