"""The local planner drives the simulated robot of PyBullet, with wheels, mass and contacts."""

import math

import numpy as np
import pytest

from actors.maps.sources import open_sources
from actors.simulators.dynamic import CONTROL_INTERVAL, DynamicSimulator
from common.config import SimulatorConfig
from common.geometry import Pose, Scan
from deploy.config import DrivingConfig
from deploy.driving import LocalPlanner
from deploy.driving.costmap import LocalCostmap
from deploy.driving.search import find_way

CONFIG = DrivingConfig()
STEPS = 3  # of the simulator per command


def points(scan: Scan, pose: Pose):
    hit = np.isfinite(scan.ranges) & (scan.ranges < scan.range_max) & (scan.ranges > 0.3)
    angles = pose.yaw + scan.angle_min + np.flatnonzero(hit) * scan.angle_increment
    ranges = scan.ranges[hit].astype(float)
    return np.column_stack((pose.x + ranges * np.cos(angles), pose.y + ranges * np.sin(angles)))


def route(world, start, goal):
    """A way on the true map that keeps the robot's room."""
    rows, columns = np.nonzero(~world.free)
    x0, y0 = world.origin
    walls = np.column_stack((x0 + (columns + 0.5) * world.resolution, y0 + (rows + 0.5) * world.resolution))
    # Cells are squares of 0.25 m: their corners are farther out than their centres.
    costmap = LocalCostmap(CONFIG.model_copy(update={"costmap_size": 36.0, "clearance": 0.25}))
    costmap.update(*start, walls, 0.0)
    return find_way(costmap, start, goal)


def drive(simulator: DynamicSimulator, world, goals: int, seed: int) -> tuple[int, int, int]:
    """Drive to random goals; return how many there were, how many were reached, and collisions."""
    generator = np.random.default_rng(seed)
    simulator.reset(world, seed)
    planner = LocalPlanner(CONFIG)
    free = np.argwhere(world.free)
    tried = reached = 0
    while tried < goals:
        row, column = free[generator.integers(len(free))]
        x0, y0 = world.origin
        goal = x0 + (column + 0.5) * world.resolution, y0 + (row + 0.5) * world.resolution
        pose = simulator.pose
        path = route(world, pose.position, goal) if 3.0 < pose.distance_to(goal) < 15.0 else []
        if not path:
            continue
        tried += 1
        planner.reset()
        seen, velocity = points(simulator.scan(), pose), (0.0, 0.0)
        for tick in range(round(60.0 / (STEPS * CONTROL_INTERVAL))):
            if tick % 2 == 0:
                seen = points(simulator.scan(), pose)
            interval, before = STEPS * CONTROL_INTERVAL, pose
            command = planner.command(before, velocity, path, seen, interval)
            for _ in range(STEPS):
                pose = simulator.advance(command.linear, command.angular)
            ahead = (pose.x - before.x) * math.cos(pose.yaw) + (pose.y - before.y) * math.sin(pose.yaw)
            velocity = ahead / interval, math.remainder(pose.yaw - before.yaw, 2.0 * math.pi) / interval
            if pose.distance_to(goal) < 0.2:
                reached += 1
                break
    return tried, reached, simulator.collisions


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("kind", ["rooms", "office", "forest"])
def test_drives_through_worlds_without_touching(kind):
    source = open_sources([f"generator:{kind}"], 0.25, "exploration")
    simulator = DynamicSimulator(SimulatorConfig(rays=360), 20.0)
    try:
        tried, reached, collisions = drive(simulator, source.world(1), goals=6, seed=1)
    finally:
        simulator.close()
    print(f"{kind}: {reached} of {tried} goals reached, {collisions} collisions")
    assert collisions == 0
    assert reached >= tried - 1
