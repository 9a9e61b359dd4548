"""Compile the kernels of the robot's mapping before the first message comes."""

from __future__ import annotations

import numpy as np

from common.geometry import Pose, Scan
from common.mapping.warmup import warm_up as warm_up_common
from deploy.config import DeployConfig, DrivingConfig
from deploy.mapping.own_body import OwnBody
from deploy.mapping.robot_map import RobotMap
from deploy.mapping.sweep import points_at_rest
from deploy.tf.transform import Transform


def warm_up() -> None:
    """Compile all kernels, or load them from numba's cache; the first call of a fresh install takes a minute.

    It maps a small room from a scan, a cloud and a SLAM's grid, so that each kernel is called as it is called later.
    """
    warm_up_common()
    warm_up_motion()
    angles = np.linspace(-np.pi, np.pi, 90, endpoint=False)
    ring = np.stack([3.0 * np.cos(angles), 3.0 * np.sin(angles), np.full(90, 0.5)], axis=1).astype(np.float32)
    for source in ("scan", "points", "grid"):
        robot_map = RobotMap(DeployConfig.model_validate({"sensing": {"source": source}}))
        robot_map.add_pose(1.0, Pose(0.0, 0.0))
        robot_map.add_scan(1.0, Scan(np.full(90, 3.0, dtype=np.float32), -np.pi, np.pi / 45, 10.0))
        robot_map.add_points(1.0, ring)
        if source == "grid":
            cells = np.zeros((80, 80), dtype=np.int8)
            cells[0] = 100
            robot_map.add_grid(1.0, cells, 0.1, (-4.0, -4.0, 0.0))
        robot_map.refresh()
        # Beside a wall the way out is looked for, too.
        robot_map.add_pose(2.0, Pose(0.0, -2.9 if source != "grid" else -3.8))
        robot_map.refresh()
        robot_map.obstacles_near(Pose(0.0, 0.0), 5.0)


def warm_up_motion() -> None:
    """Compile what only a robot that moves, or sees itself, calls."""
    OwnBody(DrivingConfig()).covers(np.zeros((1, 2)))
    places = [Transform(), Transform.planar(0.1, 0.0, 0.1), Transform.planar(0.2, 0.0, 0.2)]
    points_at_rest(np.zeros((2, 3), dtype=np.float32), np.array([0.0, 0.1]), places)
