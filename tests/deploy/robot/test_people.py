"""People in the simulated robot's world, by themselves and as its lidar meets them."""

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="PyBullet is not installed")

from actors.simulators.clearance import clearance
from common.errors import MapError
from deploy.profiles import load_deploy_config
from deploy.robot.options import RobotOptions
from deploy.robot.people import RADIUS, People
from deploy.robot.simulation import SimulatedRobot, centred, load_world

WORLD = "generator:office?width=192&height=192&seed=3"
STEP = 0.1


@pytest.fixture(scope="module")
def world():
    return centred(load_world(RobotOptions(map=WORLD)))


def walk(people, seconds, robot=(0.0, 0.0)):
    return np.array([(people.step(STEP, robot), people.positions)[1] for _ in range(round(seconds / STEP))])


def test_people_walk_about_where_they_have_room(world):
    tracks = walk(People(world, 12, 0), 60.0)
    assert min(clearance(world, tuple(place), 1.0) for place in tracks[::20].reshape(-1, 2)) >= RADIUS
    steps = np.hypot(*np.moveaxis(np.diff(tracks, axis=0), -1, 0))
    assert steps.max() <= 1.3 * STEP + 1e-9
    assert (steps.sum(axis=0) > 5.0).mean() > 0.7


def test_the_same_seed_gives_the_same_people(world):
    assert np.array_equal(walk(People(world, 5, 3), 20.0), walk(People(world, 5, 3), 20.0))
    assert not np.array_equal(walk(People(world, 5, 3), 1.0), walk(People(world, 5, 4), 1.0))


def test_people_stop_before_the_robot_and_do_not_stand_there_for_ever(world):
    people = People(world, 40, 1)
    gaps = np.hypot(*np.moveaxis(walk(people, 120.0), -1, 0))
    assert gaps.min() > RADIUS + 0.8
    near = gaps < 1.6
    assert near.any()
    assert near.all(axis=0).sum() == 0


def test_a_world_without_room_for_people_is_refused(world):
    tiny = centred(load_world(RobotOptions(map="generator:rooms?width=192&height=192&seed=5", metres_per_pixel=0.01)))
    with pytest.raises(MapError, match="no room for people.*leave --people out"):
        People(tiny, 1, 0)


def test_the_lidar_sees_people_and_running_into_one_is_a_collision():
    with SimulatedRobot(RobotOptions(map=WORLD, people=30, rays=720), load_deploy_config(profile="bare")) as robot:
        moment = robot.step(0.0)
        scan = moment.scan
        assert scan is not None
        angles = moment.truth.yaw + scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
        met = np.isfinite(scan.ranges)
        points = np.array(moment.truth.position) + (
            scan.ranges[met, None] * np.column_stack([np.cos(angles), np.sin(angles)])[met]
        )
        gaps = np.array([np.hypot(*(points - person).T).min() for person in robot.people.positions])
        seen = np.abs(gaps - RADIUS) < 0.05
        assert seen.any()
        # Nobody steps aside for it here, and it brakes for nobody.
        robot.people.step = lambda seconds, position: None
        robot.people._people[0].position = (0.6, 0.0)
        for _ in range(round(2.0 / robot.interval)):
            robot.base.receive(0.5, 0.0, robot.time, robot.time)
            robot.step(robot.time)
        assert robot.collisions == 1
