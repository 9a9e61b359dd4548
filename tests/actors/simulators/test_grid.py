import math

import numpy as np
import pytest

from actors.simulators.grid import GridSimulator
from common.config import SimulatorConfig
from common.errors import SimulatorError
from tests.actors.simulators.worlds import RANGE, at, block, hall


def simulator(**settings):
    return GridSimulator(SimulatorConfig(name="grid", **settings), RANGE)


def test_ranges_in_a_hall_are_the_distances_to_its_walls():
    sim = simulator(rays=360)
    pose = sim.reset(hall(20.0, 16.0), seed=0)
    scan = sim.scan()
    assert pose == at(5.125, 5.125)
    assert scan.ranges.dtype == np.float32
    for degrees, distance in ((0, 13.875), (90, 9.875), (180, 4.125), (270, 4.125)):
        assert scan.ranges[(degrees + 180) % 360] == pytest.approx(distance, abs=1e-5)


def test_beams_turn_with_the_robot():
    sim = simulator(rays=360)
    sim.reset(hall(20.0, 16.0), seed=0)
    sim.place(at(5.125, 5.125, math.pi / 2))
    assert sim.scan().ranges[180] == pytest.approx(9.875, abs=1e-5)


def test_beams_that_meet_nothing_are_infinite():
    sim = GridSimulator(SimulatorConfig(name="grid"), 3.0)
    sim.reset(hall(), seed=0)
    assert np.isinf(sim.scan().ranges).all()


def test_the_robot_goes_to_waypoints_and_faces_the_way_it_came():
    sim = simulator(speed=2.0)
    sim.reset(hall(), seed=0)
    leg = sim.drive_to((9.125, 8.125))
    assert leg.reached
    assert leg.pose.position == (9.125, 8.125)
    assert leg.pose.yaw == pytest.approx(math.atan2(3, 4))
    assert leg.distance == pytest.approx(5.0)
    assert leg.duration == pytest.approx(2.5)
    assert leg.collisions == 0
    assert leg.sensed == []


def test_a_wall_on_the_way_stops_the_robot_before_it():
    sim = simulator()
    world = block(hall(), 9.0, 1.0, 0.5, 14.0)
    sim.reset(world, seed=0)
    leg = sim.drive_to((13.125, 5.125))
    assert not leg.reached
    assert leg.pose.x == pytest.approx(8.9)
    assert leg.distance == pytest.approx(8.9 - 5.125)
    assert world.is_free(leg.pose.position)
    assert not sim.drive_to((13.125, 5.125)).reached
    assert sim.drive_to((5.125, 5.125)).reached


def test_staying_put_is_a_leg_of_no_length():
    sim = simulator(sense_every=1.0)
    sim.reset(hall(), seed=0)
    leg = sim.drive_to((5.125, 5.125))
    assert leg.reached
    assert leg.distance == leg.duration == 0.0
    assert leg.sensed == []


@pytest.mark.parametrize(("every", "count"), [(1.0, 3), (1.5, 2), (4.0, 0), (0.9, 4), (10.0, 0)])
def test_scans_on_the_way_are_evenly_spaced_and_leave_the_arrival_out(every, count):
    sim = simulator(sense_every=every)
    sim.reset(hall(), seed=0)
    leg = sim.drive_to((9.125, 5.125))
    assert [pose.x for pose, _ in leg.sensed] == pytest.approx([5.125 + every * k for k in range(1, count + 1)])
    if leg.sensed:
        pose, scan = leg.sensed[-1]
        sim.place(pose)
        assert np.array_equal(sim.scan().ranges, scan.ranges)


def test_a_watch_takes_the_scans_on_the_way_and_stops_the_robot():
    sim = simulator(sense_every=0.5)
    sim.reset(hall(), seed=0)
    seen = []
    leg = sim.drive_to((9.125, 5.125), lambda pose, scan: bool(seen.append(pose)) or pose.x > 7.0)
    assert leg.stopped and not leg.reached and leg.sensed == []
    assert sim.pose.x == leg.pose.x == pytest.approx(7.125)
    assert leg.distance == pytest.approx(2.0)
    assert len(seen) == 4
    assert not sim.drive_to((9.125, 5.125), lambda pose, scan: False).stopped


def test_noise_has_the_standard_deviation_that_was_asked_for_and_spares_open_beams():
    sim = GridSimulator(SimulatorConfig(name="grid", range_noise=0.05, rays=3600), 12.0)
    exact = GridSimulator(SimulatorConfig(name="grid", rays=3600), 12.0)
    sim.reset(hall(), seed=4)
    exact.reset(hall(), seed=4)
    noisy, true = sim.scan().ranges, exact.scan().ranges
    assert np.array_equal(np.isinf(noisy), np.isinf(true))
    near = true < 11.0
    error = noisy[near] - true[near]
    assert abs(error.mean()) < 0.005
    assert error.std() == pytest.approx(0.05, rel=0.1)
    assert noisy[np.isfinite(noisy)].max() < 12.0


def test_noise_repeats_with_the_seed():
    def scans(seed):
        sim = simulator(range_noise=0.05)
        sim.reset(hall(), seed=1)
        sim.scan()
        sim.reset(hall(), seed=seed)
        return [sim.scan().ranges for _ in range(3)]

    assert np.array_equal(scans(7), scans(7))
    assert not np.array_equal(scans(7), scans(8))
    assert not np.array_equal(scans(7)[0], scans(7)[1])


def test_misuse_is_answered_clearly():
    sim = simulator()
    with pytest.raises(SimulatorError, match="reset"):
        sim.scan()
    with pytest.raises(SimulatorError, match="reset"):
        sim.drive_to((1.0, 1.0))
    with pytest.raises(SimulatorError, match="start in free space"):
        sim.reset(hall(start=(0.5, 0.5)), seed=0)
    sim.reset(hall(), seed=0)
    with pytest.raises(SimulatorError, match="finite"):
        sim.drive_to((math.nan, 1.0))
    with pytest.raises(SimulatorError, match="not free"):
        sim.place(at(0.5, 0.5))
    sim.close()
    sim.close()
    with pytest.raises(SimulatorError, match="reset"):
        sim.scan()
