import math

import numpy as np
import psutil
import pytest

pytest.importorskip("pybullet", reason="PyBullet is not installed")

from actors.simulators.bullet import pybullet
from actors.simulators.kinematic import KinematicSimulator
from common.config import SimulatorConfig
from common.errors import ConfigError, SimulatorError
from tests.actors.simulators.worlds import RANGE, at, block, hall, make_world, rooms


@pytest.fixture
def make():
    made = []

    def build(sensor_range=RANGE, **settings):
        made.append(KinematicSimulator(SimulatorConfig(**settings), sensor_range))
        return made[-1]

    yield build
    for simulator in made:
        simulator.close()


def test_ranges_in_a_hall_are_the_distances_to_its_walls(make):
    sim = make(rays=360)
    assert sim.reset(hall(20.0, 16.0), seed=0) == at(5.125, 5.125)
    scan = sim.scan()
    assert scan.ranges.shape == (360,)
    for degrees, distance in ((0, 13.875), (90, 9.875), (180, 4.125), (270, 4.125)):
        assert scan.ranges[(degrees + 180) % 360] == pytest.approx(distance, abs=1e-3)
    sim.place(at(5.125, 5.125, math.pi / 2))
    assert sim.scan().ranges[180] == pytest.approx(9.875, abs=1e-3)


def test_a_sensor_sees_no_further_than_its_range(make):
    sim = make(sensor_range=4.0)
    sim.reset(hall(), seed=0)
    assert np.isinf(sim.scan().ranges).all()


def test_maps_may_lie_anywhere(make):
    sim = make(rays=16)
    sim.reset(hall(start=(-94.875, 55.125), origin=(-100.0, 50.0)), seed=0)
    assert sim.scan().ranges[0] == pytest.approx(4.125, abs=1e-3)
    assert sim.drive_to((-90.0, 60.0)).reached


def test_the_robot_goes_to_waypoints_and_stops_before_walls(make):
    sim = make(speed=1.0)
    sim.reset(block(hall(), 9.0, 7.0, 0.5, 8.0), seed=0)
    leg = sim.drive_to((11.125, 5.125))
    assert leg.reached
    assert leg.duration == pytest.approx(6.0)
    assert leg.pose == at(11.125, 5.125)
    assert sim.drive_to((11.125, 12.125)).reached
    blocked = sim.drive_to((5.125, 12.125))
    assert not blocked.reached
    assert blocked.collisions == 0
    assert blocked.pose.x == pytest.approx(9.6, abs=1e-3)
    assert sim.pose == blocked.pose


def test_a_pillar_of_one_cell_is_seen_and_stops_the_robot(make):
    sim = make()
    sim.reset(block(hall(), 9.0, 5.0), seed=0)
    assert sim.scan().ranges[360] == pytest.approx(9.0 - 5.125, abs=1e-3)
    assert not sim.drive_to((12.125, 5.125)).reached


def test_a_segment_may_touch_a_corner_but_not_pass_between_two(make):
    sim = make()
    one = block(hall(), 8.0, 9.0)
    sim.reset(make_world(one.free, start=(6.0, 7.0)), seed=0)
    assert sim.drive_to((10.25 - 0.0, 11.25)).reached is False
    sim.place(at(6.25, 7.0))
    assert sim.drive_to((10.25, 11.0)).reached, "only the corner (8.25, 9.0) is touched"
    block(one, 8.25, 8.75)
    sim.reset(make_world(one.free, start=(6.25, 7.0)), seed=0)
    assert not sim.drive_to((10.25, 11.0)).reached


def test_scans_on_the_way_equal_scans_made_there(make):
    sim = make(sense_every=1.5)
    sim.reset(rooms(), seed=0)
    leg = sim.drive_to((10.125, 9.125))
    assert len(leg.sensed) == 4
    for k, (pose, scan) in enumerate(leg.sensed, start=1):
        assert math.dist(pose.position, (5.125, 5.125)) == pytest.approx(1.5 * k)
        sim.place(pose)
        assert np.array_equal(sim.scan().ranges, scan.ranges)


def test_the_same_seed_gives_the_same_episode(make):
    def episode(sim, seed):
        sim.reset(rooms(), seed=seed)
        scans = [sim.scan().ranges]
        scans += [scan.ranges for _, scan in sim.drive_to((10.125, 9.125)).sensed]
        return np.stack([*scans, sim.scan().ranges])

    first, second = make(range_noise=0.02, sense_every=1.0), make(range_noise=0.02, sense_every=1.0)
    reference = episode(first, 3)
    assert np.array_equal(reference, episode(second, 3))
    assert not np.array_equal(reference, episode(second, 4))
    assert np.array_equal(reference, episode(second, 3))


def test_two_simulators_live_side_by_side(make):
    first, second = make(), make()
    first.reset(hall(20.0, 16.0), seed=0)
    second.reset(hall(30.0, 30.0), seed=0)
    assert first.scan().ranges[360] == pytest.approx(13.875, abs=1e-3)
    assert second.scan().ranges[360] == np.inf
    second.drive_to((15.125, 15.125))
    assert first.pose == at(5.125, 5.125)
    second.close()
    assert first.scan().ranges[360] == pytest.approx(13.875, abs=1e-3)


def test_the_3d_lidar_sees_vertical_walls_as_the_planar_one_does(make):
    planar, layered = make(), make(lidar_layers=16)
    for pose in (at(5.125, 5.125), at(10.125, 9.125, 0.7), at(22.125, 16.125, -2.0)):
        for sim in (planar, layered):
            sim.reset(rooms(), seed=0)
            sim.place(pose)
        a, b = planar.scan().ranges, layered.scan().ranges
        assert np.array_equal(np.isinf(a), np.isinf(b))
        met = np.isfinite(a)
        assert np.mean(np.abs(a[met] - b[met]) < 0.01) > 0.995


def test_the_point_cloud_lies_on_walls_and_floor(make):
    sim = make(lidar_layers=16, wall_height=1.5)
    world = rooms()
    sim.reset(world, seed=0)
    with pytest.raises(SimulatorError, match="scan"):
        sim.point_cloud()
    sim.scan()
    cloud = sim.point_cloud()
    assert cloud.shape[1] == 3
    assert cloud[:, 2].min() == pytest.approx(0.0, abs=1e-3)
    assert 1.3 < cloud[:, 2].max() <= 1.5 + 1e-3
    walls = cloud[cloud[:, 2] > 0.01]
    floor = cloud[cloud[:, 2] <= 0.01]
    assert len(walls) > 1000
    assert len(floor) > 1000
    assert np.mean([world.is_free((x, y)) for x, y, _ in floor[::20]]) > 0.98
    for x, y, _ in walls[::20]:
        beside = [world.is_free((x + dx, y + dy)) for dx in (-0.01, 0.01) for dy in (-0.01, 0.01)]
        assert any(beside)
        assert not all(beside)


def test_more_rays_than_one_call_takes_are_cast_in_several(make):
    many, few = make(rays=1800, lidar_layers=16), make(rays=360, lidar_layers=16)
    assert pybullet.MAX_RAY_INTERSECTION_BATCH_SIZE < 1800 * 16
    for sim in (many, few):
        sim.reset(rooms(), seed=0)
    assert np.array_equal(many.scan().ranges[::5], few.scan().ranges)


def test_closing_twice_is_fine_and_a_closed_simulator_says_so(make):
    sim = make()
    sim.reset(hall(), seed=0)
    sim.close()
    sim.close()
    with pytest.raises(SimulatorError, match="reset"):
        sim.scan()
    with pytest.raises(SimulatorError, match="closed"):
        sim.reset(hall(), seed=0)


def test_walls_that_the_lidar_would_look_over_are_refused():
    with pytest.raises(ConfigError, match="wall_height"):
        KinematicSimulator(SimulatorConfig(wall_height=0.3), RANGE)


def test_memory_does_not_grow_with_resets(make):
    sim = make(rays=90)
    worlds = [rooms(), block(rooms(), 7.0, 4.0, 2.0, 1.0)]
    process = psutil.Process()

    def resets(count):
        for seed in range(count):
            sim.reset(worlds[seed % 2], seed=seed)
            sim.scan()
        return process.memory_info().rss

    before = resets(50)
    assert resets(150) - before < 2**21
