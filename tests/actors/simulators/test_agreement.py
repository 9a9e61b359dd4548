"""The simulators agree: same map, same poses, same beliefs."""

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="PyBullet is not installed")

from actors.simulators.dynamic import DynamicSimulator
from actors.simulators.grid import GridSimulator
from actors.simulators.kinematic import KinematicSimulator
from common.config import SimulatorConfig
from tests.actors.simulators.worlds import RANGE, ROUTE, agreement, empty_belief, filled, rooms


@pytest.mark.parametrize(
    ("make", "layers", "agree"),
    [
        (KinematicSimulator, 1, 0.999),
        (DynamicSimulator, 1, 0.99),
        (KinematicSimulator, 16, 0.99),
        (DynamicSimulator, 16, 0.97),
    ],
)
def test_beliefs_and_ranges_agree_with_the_grid_simulator(make, layers, agree):
    world = rooms()
    grid = GridSimulator(SimulatorConfig(name="grid"), RANGE)
    other = make(SimulatorConfig(lidar_layers=layers, lidar_rate=0.2), RANGE)
    try:
        grid.reset(world, seed=0)
        other.reset(world, seed=0)
        beliefs = empty_belief(world), empty_belief(world)
        errors = []
        for waypoint in ROUTE:
            leg = other.drive_to(waypoint)
            assert leg.reached
            grid.place(leg.pose)
            scans = grid.scan(), other.scan()
            for belief, scan in zip(beliefs, scans, strict=True):
                belief.integrate(scan, leg.pose)
            errors.append(np.abs(filled(scans[0]) - filled(scans[1])))
    finally:
        other.close()
    assert beliefs[0].known_cells > 3000
    assert agreement(world, *beliefs) >= agree
    assert np.mean(np.concatenate(errors) < 0.01) > 0.99


def test_blocked_legs_agree_too():
    world = rooms()
    grid = GridSimulator(SimulatorConfig(name="grid"), RANGE)
    other = KinematicSimulator(SimulatorConfig(), RANGE)
    random = np.random.default_rng(0)
    try:
        grid.reset(world, seed=0)
        other.reset(world, seed=0)
        blocked = 0
        for x, y in random.uniform((0.0, 0.0), world.size, (200, 2)):
            legs = grid.drive_to((x, y)), other.drive_to((x, y))
            assert legs[0].reached == legs[1].reached
            assert legs[0].pose.position == pytest.approx(legs[1].pose.position, abs=0.005)
            blocked += not legs[0].reached
            other.place(legs[0].pose)
    finally:
        other.close()
    assert 20 < blocked < 180
