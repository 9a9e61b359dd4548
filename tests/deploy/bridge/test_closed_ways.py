"""What appears on a way that was free may go away again: a person in a corridor, a box on the target."""

import numpy as np
import pytest

from actors.maps.grid_map import GridMap
from common.geometry import Pose
from deploy.bridge.mission import Phase
from deploy.mapping.robot_map import RobotMap
from tests.deploy.bridge.offline import Trial, ended, settings

CELL = 0.25
START, FAR = (3.0, 3.0), (21.0, 3.0)
HALL, CORRIDOR, END = (1.0, 7.0), (7.0, 15.0), (15.0, 23.0)
MAPPING = {
    "resolution": CELL,
    "sensor_range": 15.0,
    "viewpoint_spacing": 3.0,
    "beacon_range": 15.0,
    "robot_radius": 0.25,
}


def block(world: GridMap, x: tuple[float, float], y: tuple[float, float], *, free: bool = False) -> None:
    """Put something onto the floor, or take it away; metres."""
    rows, columns = (slice(*(round(value / CELL) for value in span)) for span in (y, x))
    world.free[rows, columns] = free


def corridor() -> GridMap:
    """Two rooms of 6 m and 8 m x 6 m with a corridor of 8 m between them, 1.25 m wide."""
    world = GridMap("corridor", np.zeros((32, 96), dtype=bool), CELL, (0.0, 0.0), START, None, None, (1.0, 1.0))
    for span in (HALL, END):
        block(world, span, (1.0, 7.0), free=True)
    block(world, CORRIDOR, (3.0, 4.25), free=True)
    return world


class Measured(RobotMap):
    """The robot's own map, which forgets what is no longer there."""

    def __init__(self, config):
        super().__init__(config)
        self.now = 0.0

    def add(self, scan, pose):
        self.now += 0.1
        self.add_pose(self.now, pose)
        self.add_scan(self.now, scan)


def started(world, **sections):
    config = settings(
        **{"mapping": MAPPING, "sensing": {"range_noise": 0.0}, "safety": {"blacklist_time": 20.0}, **sections}
    )
    trial = Trial(world, config, make_map=lambda mapping, lattice: Measured(config))
    trial.mission.start()
    return trial


PERSON = (10.0, 10.5), (3.0, 4.25)


@pytest.mark.parametrize("goal", [None, FAR])
def test_a_person_in_a_corridor_is_waited_for(goal):
    world = corridor()
    trial = started(world)
    if goal is not None:
        trial.mission.goal(goal)
    trial.run(10, lambda o: o.pose is not None and o.pose.x > 6.0)
    block(world, *PERSON)
    last = trial.run(15)
    assert last.orders.moving
    assert "something closes the way to" in last.hold
    # It has come near, to see when the way opens.
    assert 8.0 < trial.pose.x < 10.0
    block(world, *PERSON, free=True)
    last = trial.run(60, ended)
    assert last.orders.phase is Phase.FINISHED
    assert trial.pose.x > 15.0
    if goal is None:
        assert last.orders.reason.startswith("complete")


def test_who_stands_in_the_way_home_is_waited_for():
    world = corridor()
    trial = started(world)
    trial.run(60, lambda o: trial.pose.x > 16.0)
    block(world, *PERSON)
    trial.mission.return_home()
    assert "something closes the way to" in trial.run(12).hold
    block(world, *PERSON, free=True)
    assert trial.run(60, ended).orders.phase is Phase.FINISHED
    assert trial.pose.distance_to(START) <= 0.8


def test_a_way_that_stays_closed_is_given_up_and_the_end_says_what_is_left():
    world = corridor()
    trial = started(world)
    trial.run(10, lambda o: o.pose is not None and o.pose.x > 6.0)
    block(world, *PERSON)
    began = trial.now
    last = trial.run(60, ended)
    assert last.orders.phase is Phase.FINISHED
    assert trial.now - began > 20.0
    assert last.orders.reason.startswith("not complete: something that was not there before closes the way")
    assert last.unseen is not None
    assert last.unseen.position[0] > 10.5


def test_a_door_that_closes_behind_the_robot_is_not_waited_for():
    """Nothing is left to see behind it."""
    world = corridor()
    trial = started(world)
    trial.run(60, lambda o: trial.pose.x > 16.0)
    block(world, *PERSON)
    last = trial.run(15, ended)
    assert last.orders.phase is Phase.FINISHED
    assert last.orders.reason.startswith("complete")


def test_a_robot_wedged_in_says_so_and_is_not_done():
    world = corridor()
    # A corridor in which the robot fits, and that is a little narrower before and behind it.
    block(world, CORRIDOR, (3.75, 4.25))
    for x in (10.25, 11.25):
        block(world, (x, x + CELL), (3.0, 3.25))
    trial = started(world)
    trial.pose = Pose(10.9, 3.375)
    trial.simulator.place(trial.pose)
    last = trial.run(10, ended)
    assert last.orders.moving
    assert "a robot that needs 0.25 m of room cannot leave" in last.hold
    assert "mapping.robot_radius" in last.hold
