"""Hundreds of drives through random obstacles: none may touch anything."""

import numpy as np
import pytest

from common.geometry import Pose
from deploy.config import DrivingConfig
from deploy.driving import LocalPlanner
from tests.deploy.driving.vehicle import Vehicle, pillar, run, wall

CONFIG = DrivingConfig()
GOAL = (8.0, 0.0)


def field(generator: np.random.Generator):
    """Pillars and walls between the start and the goal, which stay clear."""
    parts = []
    for _ in range(generator.integers(8, 30)):
        x, y = generator.uniform(-1.0, 9.0), generator.uniform(-4.0, 4.0)
        if generator.random() < 0.7:
            parts.append(pillar(x, y, generator.uniform(0.08, 0.5)))
        else:
            parts.append(wall((x, y), (x + generator.uniform(-1.5, 1.5), y + generator.uniform(-1.5, 1.5))))
    world = np.vstack(parts)
    clear = [np.hypot(world[:, 0] - x, world[:, 1] - y) > 0.5 for x, y in ((0.0, 0.0), GOAL)]
    return world[clear[0] & clear[1]]


def drive(seeds) -> tuple[int, float]:
    planner = LocalPlanner(CONFIG)
    reached, nearest = 0, np.inf
    for seed in seeds:
        generator = np.random.default_rng(seed)
        vehicle = Vehicle(Pose(0.0, 0.0), field(generator))
        vehicle.pose = Pose(0.0, 0.0, generator.uniform(-3.1, 3.1))
        planner.reset()
        arrived, *_ = run(vehicle, [GOAL], CONFIG, planner=planner, until=0.2)
        assert vehicle.nearest >= CONFIG.robot_radius, f"seed {seed}: {vehicle.nearest:.3f} m at {vehicle.pose}"
        reached += arrived
        nearest = min(nearest, vehicle.nearest)
    return reached, nearest


def test_few_random_fields():
    reached, _ = drive(range(3))
    assert reached == 3


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_many_random_fields():
    reached, nearest = drive(range(200))
    print(f"{reached} of 200 reached the goal; the nearest obstacle came within {nearest:.3f} m of the centre")
    assert reached >= 195
