"""No kernel of the mapping compiles while the robot drives."""

import numpy as np

from common.geometry import Pose
from deploy.mapping import cloud, log_odds, rims, slam_grid, volume
from deploy.mapping.robot_map import RobotMap
from deploy.mapping.warmup import warm_up
from tests.deploy.mapping.lidar import cloud_at, configure, room, scan_at

KERNELS = (
    cloud._project,
    rims.close_rims,
    log_odds._trace,
    log_odds._apply,
    slam_grid._resample,
    volume._add,
)


def test_everything_is_compiled_before_the_first_message():
    warm_up()
    before = [len(kernel.signatures) for kernel in KERNELS]
    assert min(before) == 1
    for source in ("scan", "points", "grid"):
        robot_map = RobotMap(configure(sensing={"source": source}, mapping={"robot_radius": 0.3}))
        for k in range(3):
            pose = Pose(1.0 + k, 0.6)
            robot_map.add_pose(float(k), pose)
            robot_map.add_scan(float(k), scan_at(room(), pose))
            robot_map.add_points(float(k), cloud_at(room(), pose))
            robot_map.add_grid(float(k), np.zeros((40, 60), dtype=np.int8), 0.25, (0.0, 0.0, 0.0))
            robot_map.refresh()
    assert [len(kernel.signatures) for kernel in KERNELS] == before
