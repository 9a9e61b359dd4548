import numpy as np
import pytest

pytest.importorskip("pybullet")

from actors.evaluation.large.robot import LIDAR
from actors.evaluation.large.simulator import NotedSimulator
from actors.maps.generators import make_generator
from actors.simulators.dynamic import DynamicSimulator
from common.config import SimulatorConfig
from common.geometry import Pose


def test_it_measures_what_rays_through_the_physics_world_measure():
    config = SimulatorConfig(**LIDAR)
    world = make_generator("building", {"width": "192", "height": "192"}).world(0)
    fast, rays = NotedSimulator(config, 20.0), DynamicSimulator(config, 20.0)
    try:
        for simulator in (fast, rays):
            simulator.reset(world, seed=0)
        # Driving tilts the robot, the lidar with it, a little.
        for step in range(60):
            for simulator in (fast, rays):
                simulator.advance(2.0 if step < 40 else 0.0, 0.3)
            assert fast.pose == rays.pose
            if step % 15:
                continue
            ours, theirs = fast.scan(), rays.scan()
            a, b = fast._lidar._ranges, rays._lidar._ranges
            assert np.mean(np.isfinite(a) == np.isfinite(b)) > 0.998
            both = np.isfinite(a) & np.isfinite(b)
            assert both.mean() > 0.5
            assert np.mean(np.abs(a[both] - b[both]) < 0.005) > 0.995
            assert np.mean(np.abs(ours.ranges - theirs.ranges) < 0.005) > 0.99
        fast.place(Pose(*world.start))
        assert np.ptp(fast.point_cloud()[:, 2]) == pytest.approx(2.0, abs=0.05)
    finally:
        fast.close()
        rays.close()
