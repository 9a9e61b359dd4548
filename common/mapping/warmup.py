"""Compile every kernel of the mapping once, so that processes started later only load them."""

from __future__ import annotations

import numpy as np

from common.config import MappingConfig
from common.geometry import Pose, Scan
from common.mapping.mapper import Mapper
from common.mapping.raycast import cast_rays, ray_angles


def warm_up() -> None:
    """Compile all kernels, or load them from numba's cache; call it once before processes start.

    It drives a robot through a small world with a target, so that whatever the mapping calls has been called with the
    types that it is called with. The first call of a fresh install takes about half a minute.
    """
    free = np.ones((48, 48), dtype=np.bool_)
    free[20:30, 24] = False
    config = MappingConfig(resolution=0.5, sensor_range=8.0, viewpoint_spacing=2.0, beacon_range=4.0, robot_radius=0.6)
    mapper = Mapper(config, lattice_origin=(0.0, 0.0), target=(22.0, 12.0))
    angles = ray_angles(0.0, 0.0, np.pi / 36, 72)
    for x in (4.0, 10.0, 20.0):
        pose = Pose(x, 12.0)
        ranges = cast_rays(free, 0.5, 0.0, 0.0, pose.x, pose.y, angles, 8.0)
        mapper.integrate(Scan(ranges, 0.0, np.pi / 36, 8.0), pose)
        mapper.update(pose)
    mapper.observe()
    mapper.distances(0)
    for a, b in mapper.edges.tolist():
        mapper.way(a, b)
    mapper.way_home()
    mapper.sightings()
    mapper.reachable_cells()
    # Clear space, then beside a wall.
    mapper.segment_free((4.0, 12.0), (6.0, 12.0))
    mapper.segment_free((12.3, 9.0), (14.0, 9.0))
