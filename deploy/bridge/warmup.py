"""Compile, or load from the cache, whatever a decision runs, before the robot depends on its time."""

from __future__ import annotations

import logging
import time

import numpy as np

from common.errors import HDError
from common.geometry import Pose, Scan
from common.mapping.mapper import Mapper
from common.mapping.raycast import cast_rays, ray_angles
from common.mapping.warmup import warm_up as warm_up_mapping
from common.planners.base import Planner, TaskName, with_deputies
from common.tasks import find_task
from deploy.bridge.cell_way import pieces
from deploy.bridge.unseen import find_unseen, go_to_unseen
from deploy.bridge.way_out import way_out
from deploy.config import DeployConfig
from deploy.driving import LocalPlanner
from deploy.mapping.robot_map import RobotMap
from deploy.mapping.warmup import warm_up_motion

log = logging.getLogger(__name__)

# Metres per cell of the small world. Where little is known and much of its edge open, `tour` makes no tour.
_CELL = 0.5
# In cells.
_PLACES = ((12, 30), (20, 30), (32, 32))
_BEAMS = 720
# So often each place is seen before anything is decided there: what was seen once may not be free yet.
_SCANS = 3


def warm_up(config: DeployConfig, planners: list[tuple[Planner, TaskName]]) -> None:
    """Let map, planners, what helps them, and the local planner work once in a small world of their own.

    Args:
        config: whole tree.
        planners: those that may be asked, each with the task it will have; they are to be reset afterwards.
    """
    began = time.perf_counter()
    warm_up_mapping()
    warm_up_motion()
    cell = _CELL
    target = (50.0 * cell, 50.0 * cell)
    # Poses come from here, whatever the robot's own source of them is.
    sensing = config.sensing.model_copy(update={"pose": "odometry"})
    robot_map = RobotMap(config.model_copy(update={"sensing": sensing}), target)
    # An exploration closes small holes and rims, a navigation does not.
    explored = RobotMap(config.model_copy(update={"sensing": sensing}))
    maps = (robot_map, explored)
    free = np.zeros((60, 60), dtype=np.bool_)
    free[2:58, 2:58] = True
    for wall in (24, 42):
        free[:, wall] = False
        free[26:34, wall] = True
    free[42, 2:40] = False
    free[42, 10:16] = True
    reach = min(10.0, config.mapping.sensor_range)
    angles = ray_angles(0.0, 0.0, 2.0 * np.pi / _BEAMS, _BEAMS)
    for planner, task in planners:
        planner.reset(task, target if find_task(task).needs_target else None, 0)
    for number, (column, row) in enumerate(_PLACES):
        x, y = column * cell, row * cell
        pose = Pose(x, y)
        ranges = cast_rays(free, cell, 0.0, 0.0, x, y, angles, reach)
        met = np.isfinite(ranges)
        ends = np.stack([x + ranges[met] * np.cos(angles[met]), y + ranges[met] * np.sin(angles[met])], axis=1)
        for scan in range(_SCANS):
            stamp = 1.0 + number + 0.1 * scan
            for each in maps:
                each.add_pose(stamp, pose)
            if config.sensing.source == "grid":
                for each in maps:
                    each.add_grid(stamp, np.where(free, 0, 100).astype(np.int8), cell, (0.0, 0.0, 0.0))
            else:
                points = np.column_stack([ends, np.full(len(ends), 0.5)]).astype(np.float32)
                for each in maps:
                    each.add_scan(stamp, Scan(ranges, 0.0, 2.0 * np.pi / _BEAMS, reach))
                    each.add_points(stamp, points)
            mapper = robot_map.refresh()
            exploring = explored.refresh()
            if exploring is not None:
                # Asked for, frontiers are kept up to date by what changes.
                _ = exploring.frontier_cells
                exploring.nodes_at(np.array([pose.position]))
        if mapper is not None:
            for planner, _ in planners:
                for deputy in with_deputies(planner):
                    _try(deputy, mapper, pose)
            if not mapper.stuck:
                find_unseen(mapper, config.mapping.robot_radius)
                go_to_unseen(mapper, pose, config.mapping.robot_radius, lambda _: False)
                # As where somebody closes a way.
                list(pieces(mapper.room, mapper.room, 1))
            # Beside the wall the way out is looked for.
            beside = Pose(x, 2.0 * cell + 0.1)
            mapper.update(beside)
            mapper.segment_free(beside.position, pose.position)
            way_out(mapper, beside, 1.0)
        if config.driving.enabled:
            local = LocalPlanner(config.driving)
            local.command(pose, (0.0, 0.0), [(x + 1.0, y)], robot_map.obstacles_near(pose, 4.0), 0.05)
    log.info("ready to decide after %.1f s of preparation", time.perf_counter() - began)


def _try(planner: Planner, mapper: Mapper, pose: Pose) -> None:
    try:
        planner.plan(mapper, pose)
    except HDError as error:
        # A small world may not suit every planner; what matters is that its kernels are there.
        log.debug("planner %s in the world of preparation: %s", planner.name, error)
