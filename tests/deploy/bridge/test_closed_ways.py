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


def corridor(y: float = 3.0) -> GridMap:
    """Two rooms of 6 m and 8 m x 6 m with a corridor of 8 m between them, 1.25 m wide from y on."""
    world = GridMap("corridor", np.zeros((32, 96), dtype=bool), CELL, (0.0, 0.0), START, None, None, (1.0, 1.0))
    for span in (HALL, END):
        block(world, span, (1.0, 7.0), free=True)
    block(world, CORRIDOR, (y, y + 1.25), free=True)
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


def offices(number: int) -> GridMap:
    """Rooms of 3 m x 6 m along a hall, each with a door of 1.25 m."""
    world = GridMap(
        "offices", np.zeros((48, 16 * number + 4), dtype=bool), CELL, (0.0, 0.0), START, None, None, (1.0, 1.0)
    )
    block(world, (1.0, 4.0 * number), (2.0, 4.0), free=True)
    for k in range(number):
        block(world, (4.0 * k + 1.0, 4.0 * k + 4.0), (4.5, 10.5), free=True)
        block(world, office_door(k), (4.0, 4.5), free=True)
    return world


def office_door(k: int) -> tuple[float, float]:
    return 4.0 * k + 1.75, 4.0 * k + 3.0


def test_many_closed_ways_are_waited_for_less_than_twice_as_long_as_one():
    world = offices(5)
    trial = started(world, decision={"planner": "nearest"})
    # It has looked into each room from before its door, as somebody pushed it along the hall.
    trial.frozen = True
    for k in range(5):
        trial.pose = Pose(office_door(k)[0] + 0.6, 2.6)
        trial.simulator.place(trial.pose)
        trial.run(0.6)
    trial.frozen = False
    for k in range(5):
        block(world, office_door(k), (4.25, 4.5))
    began = trial.now
    last = trial.run(200, ended)
    assert last.orders.phase is Phase.FINISHED
    assert last.orders.reason.startswith("not complete: something that was not there before closes the way")
    waits = {o.hold.split(" m,")[0] for o in trial.outcomes if "something closes the way" in o.hold}
    assert len(waits) >= 3
    # It waits for 20 s at the first, half as long at the next.
    assert trial.now - began - trial.distance / 2.0 < 2 * 20.0 + 10.0


def test_a_pause_is_no_time_of_waiting():
    world = corridor()
    trial = started(world)
    trial.run(10, lambda o: o.pose is not None and o.pose.x > 6.0)
    block(world, *PERSON)
    trial.run(20, lambda o: "something closes the way" in o.hold)
    trial.mission.pause()
    trial.run(30)
    trial.mission.resume()
    last = trial.run(10)
    assert last.orders.moving
    assert "something closes the way" in last.hold
    assert trial.run(30, ended).orders.phase is Phase.FINISHED


@pytest.mark.parametrize("order", ["goal", "return_home"])
def test_an_order_to_go_where_a_way_was_closed_before_is_carried_out_when_it_opens(order):
    world = corridor()
    trial = started(world)
    trial.run(60, lambda o: trial.pose.x > 13.0)
    block(world, *PERSON)
    assert trial.run(20, ended).orders.phase is Phase.FINISHED
    trial.mission.return_home() if order == "return_home" else trial.mission.goal(START)
    assert "something closes the way to" in trial.run(12).hold
    block(world, *PERSON, free=True)
    assert trial.run(60, ended).orders.phase is Phase.FINISHED
    assert trial.pose.distance_to(START) <= 0.8


def test_a_closed_way_is_not_overlooked_for_all_that_stands_about():
    """Chairs that came since the robot passed there cut off small pieces of floor."""
    world = corridor(5.75)
    trial = started(world)
    trial.run(10, lambda o: o.pose is not None and o.pose.x > 6.0)
    block(world, (10.0, 10.5), (5.75, 7.0))
    for x in np.arange(1.5, 6.5, 1.0):
        for y in np.arange(1.25, 5.0, 1.0):
            block(world, (x, x + CELL), (y, y + CELL))
    last = trial.run(15)
    assert last.orders.moving
    assert "something closes the way to" in last.hold


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
