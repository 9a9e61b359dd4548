"""No kernel of the mapping compiles while the robot drives."""

import numpy as np

from common.geometry import Pose
from deploy.mapping import cloud, log_odds, own_body, rims, slam_grid, sweep, volume
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
    own_body._covers,
    sweep._at_rest,
)


def test_everything_is_compiled_before_the_first_message():
    warm_up()
    before = [len(kernel.signatures) for kernel in KERNELS]
    assert min(before) == 1
    for source in ("scan", "points", "grid"):
        robot_map = RobotMap(
            configure(sensing={"source": source}, mapping={"robot_radius": 0.4}, driving={"robot_radius": 0.4})
        )
        for k in range(3):
            pose = Pose(1.0 + k, 0.6)
            robot_map.add_pose(float(k), pose)
            robot_map.add_pose(k + 0.1, Pose(pose.x + 0.1, pose.y, 0.1))
            scan, points = scan_at(room(), pose), cloud_at(room(), pose, frame="sensor")
            scan.ranges[:20] = 0.35
            robot_map.add_scan(float(k), scan, sweep=0.1)
            robot_map.add_points(float(k), points, "base_link", np.linspace(0.0, 0.1, len(points)))
            robot_map.add_grid(float(k), np.zeros((40, 60), dtype=np.int8), 0.25, (0.0, 0.0, 0.0))
            robot_map.refresh()
    assert [len(kernel.signatures) for kernel in KERNELS] == before
