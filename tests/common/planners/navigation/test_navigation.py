from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from actors.maps.grid_map import GridMap
from common.config import MappingConfig
from common.errors import ConfigError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Planner, Status
from common.planners.registry import make_planner
from tests.common.planners.rollout import drawn, navigate

CONFIG = MappingConfig(resolution=0.5)
NAMES = ["dstar_lite", "astar", "bit_star", "far"]


def planner(name: str) -> Planner:
    if name == "bit_star":
        pytest.importorskip("ompl", reason="OMPL is not installed (extra `planners`)")
        return make_planner(name, CONFIG, samples_per_batch=60, batches=1, max_batches=30)
    return make_planner(name, CONFIG)


ONE_ROOM = drawn(["########", "#S.....#", "#......#", "#.....T#", "########"])
TWO_ROOMS = drawn(
    [
        "############",
        "#S...#....T#",
        "#....#.....#",
        "#....#.....#",
        "#..........#",
        "############",
    ]
)
# The way that looks short ends in a bag.
DEAD_END = drawn(
    [
        "#############",
        "#...........#",
        "#.########..#",
        "#.#......#..#",
        "#.#.S....#.T#",
        "#.#......#..#",
        "#.#.#####...#",
        "#...#...#...#",
        "#############",
    ]
)
SEALED = drawn(
    [
        "###########",
        "#.........#",
        "#.S...###.#",
        "#.....#T#.#",
        "#.....###.#",
        "#.........#",
        "###########",
    ]
)
IN_A_WALL = drawn(
    [
        "###########",
        "#.........#",
        "#.S...###.#",
        "#.....#t#.#",
        "#.....###.#",
        "#.........#",
        "###########",
    ]
)
CLOSED_IN = drawn(["########", "#S#...T#", "###....#", "########"])


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("place", "shortest", "longest"),
    [(ONE_ROOM, 21.5, 23.0), (TWO_ROOMS, 40.0, 50.0), (DEAD_END, 40.0, 110.0)],
    ids=["one room", "two rooms", "dead end"],
)
def test_the_robot_arrives(name: str, place: GridMap, shortest: float, longest: float) -> None:
    journey = navigate(planner(name), place, CONFIG)
    assert journey.complete, journey.reason
    assert shortest - 1.6 <= journey.distance <= longest


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("place", [SEALED, IN_A_WALL, CLOSED_IN], ids=["sealed", "in a wall", "closed in"])
def test_a_target_that_cannot_be_reached_is_said_to_be_so(name: str, place: GridMap) -> None:
    journey = navigate(planner(name), place, CONFIG, max_steps=60)
    assert journey.status is Status.UNREACHABLE, (journey.status, journey.reason)
    assert "target" in journey.reason


@pytest.mark.parametrize("name", NAMES)
def test_it_is_complete_on_the_target(name: str) -> None:
    place = dataclasses.replace(ONE_ROOM, target=ONE_ROOM.start)
    mapper = Mapper(CONFIG, lattice_origin=place.lattice_origin, target=place.target)
    mapper.update(Pose(*place.start))
    made = planner(name)
    made.reset("navigation", place.target, 0)
    assert made.plan(mapper, Pose(*place.start)).status is Status.COMPLETE


@pytest.mark.parametrize("name", NAMES)
def test_a_robot_that_knows_nothing_is_stuck(name: str) -> None:
    mapper = Mapper(CONFIG, lattice_origin=(2.0, 2.0), bounds=(0.0, 0.0, 40.0, 40.0), target=(30.0, 30.0))
    mapper.update(Pose(10.0, 10.0))
    made = planner(name)
    made.reset("navigation", (30.0, 30.0), 0)
    plan = made.plan(mapper, Pose(10.0, 10.0))
    assert plan.status is Status.STUCK
    assert plan.reason


@pytest.mark.parametrize("name", NAMES)
def test_a_known_world_without_frontiers_is_no_obstacle(name: str) -> None:
    """Everything is known: the path is the shortest one, and it stays so."""
    place = TWO_ROOMS
    mapper = Mapper(CONFIG, lattice_origin=place.lattice_origin, target=place.target)
    mapper.belief.assign(np.where(place.free, np.int8(0), np.int8(100)), place.origin)
    pose = Pose(*place.start)
    made = planner(name)
    made.reset("navigation", place.target, 0)
    length = 0.0
    for _ in range(30):
        mapper.update(pose)
        plan = made.plan(mapper, pose)
        if plan.status is not Status.GOING:
            break
        assert plan.waypoint is not None
        length += pose.distance_to(plan.waypoint)
        pose = Pose(*plan.waypoint)
    assert plan.status is Status.COMPLETE
    assert 37.0 < length < 48.0
    # Now a wall closes the passage.
    cells = np.where(place.free, np.int8(0), np.int8(100))
    cells[:, 40:48] = 100
    mapper.belief.assign(cells, place.origin)
    mapper.update(Pose(*place.start))
    assert made.plan(mapper, Pose(*place.start)).status is Status.UNREACHABLE


@pytest.mark.parametrize("name", NAMES)
def test_a_belief_that_grows_from_nothing_leads_to_the_target(name: str) -> None:
    journey = navigate(planner(name), TWO_ROOMS, CONFIG, bounded=False)
    assert journey.complete, journey.reason


@pytest.mark.parametrize("name", NAMES)
def test_equal_seeds_give_equal_routes(name: str) -> None:
    made = planner(name)
    first, again = (navigate(made, TWO_ROOMS, CONFIG, seed=3, max_steps=4) for _ in range(2))
    assert first.waypoints == again.waypoints


@pytest.mark.parametrize("name", ["bit_star", "far"])
def test_a_robot_that_stops_before_near_bends_goes_on(name: str) -> None:
    """It does not move for a waypoint within 0.5 m: paths that bend there must not hold it."""
    journey = navigate(planner(name), DEAD_END, CONFIG, slack=0.5)
    assert journey.complete, journey.reason
    assert journey.distance <= 95.0
    moves = np.hypot(*np.diff(np.array(journey.waypoints), axis=0).T)
    assert np.count_nonzero(moves < 1e-6) <= 3


def test_another_seed_gives_bit_star_another_route() -> None:
    made = planner("bit_star")
    routes = [navigate(made, TWO_ROOMS, CONFIG, seed=seed, max_steps=2).waypoints for seed in (3, 4)]
    assert routes[0] != routes[1]


@pytest.mark.parametrize("name", NAMES)
def test_a_robot_that_does_not_move_is_offered_other_ways_and_then_none(name: str) -> None:
    """As when something stands in the way that the sensor does not see."""
    place = TWO_ROOMS
    mapper = Mapper(CONFIG, lattice_origin=place.lattice_origin, target=place.target)
    mapper.belief.assign(np.where(place.free, np.int8(0), np.int8(100)), place.origin)
    pose = Pose(*place.start)
    mapper.update(pose)
    made = planner(name)
    made.reset("navigation", place.target, 0)
    waypoints = set()
    for _ in range(40):
        plan = made.plan(mapper, pose)
        if plan.status is not Status.GOING:
            break
        waypoints.add(plan.waypoint)
    assert len(waypoints) > 1
    assert plan.status is Status.STUCK
    assert "did not move" in plan.reason


@pytest.mark.parametrize("name", NAMES)
def test_bad_requests_are_refused(name: str) -> None:
    made = planner(name)
    mapper = Mapper(CONFIG, lattice_origin=(2.0, 2.0))
    with pytest.raises(ConfigError, match="call reset"):
        made.plan(mapper, Pose(0.0, 0.0))
    with pytest.raises(ConfigError, match="not exploration"):
        made.reset("exploration", None, 0)
    with pytest.raises(ConfigError, match="needs a target"):
        made.reset("navigation", None, 0)
    with pytest.raises(ConfigError, match="needs a target"):
        made.reset("navigation", (float("nan"), 0.0), 0)
    with pytest.raises(ConfigError, match="arrival_radius"):
        make_planner(name, CONFIG, arrival_radius=0.0)


def test_bit_star_refuses_an_empty_budget() -> None:
    with pytest.raises(ConfigError, match="batches"):
        make_planner("bit_star", CONFIG, batches=9, max_batches=3)
