import numpy as np
import psutil
import pytest

pytest.importorskip("pybullet", reason="PyBullet is not installed")

from actors.simulators.kinematic import KinematicSimulator
from actors.simulators.view import render
from common.config import SimulatorConfig
from tests.actors.simulators.worlds import RANGE, at, hall, rooms


@pytest.fixture
def visible():
    simulator = KinematicSimulator(SimulatorConfig(rays=36), RANGE, visible=True)
    yield simulator
    simulator.close()


def picture(simulator):
    return render(
        simulator.physics.client, (10.0, 8.0, 0.0), distance=20.0, yaw=0.0, pitch=-89.0, size=(120, 90)
    ).astype(int)


def test_pictures_show_walls_floor_and_where_the_robot_is(visible):
    visible.reset(hall(), seed=0)
    first = picture(visible)
    assert first.shape == (90, 120, 3)
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 3
    visible.place(at(14.0, 12.0))
    second = picture(visible)
    assert np.array_equal(second, picture(visible))
    changed = np.argwhere(np.abs(first - second).max(axis=2) > 20)
    assert 0 < len(changed) < 200
    visible.place(at(5.125, 5.125))
    assert np.array_equal(first, picture(visible))


def test_a_world_to_look_at_is_sensed_as_any_other(visible):
    plain = KinematicSimulator(SimulatorConfig(rays=36), RANGE)
    try:
        for simulator in (plain, visible):
            simulator.reset(rooms(), seed=0)
        assert np.array_equal(plain.scan().ranges, visible.scan().ranges)
    finally:
        plain.close()


def test_memory_does_not_grow_with_visible_worlds(visible):
    process = psutil.Process()

    def resets(count):
        for seed in range(count):
            visible.reset(rooms(), seed=seed)
        return process.memory_info().rss

    before = resets(15)
    assert resets(45) - before < 2**21
