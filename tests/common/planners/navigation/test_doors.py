"""Navigation in buildings by robots with a size: they arrive exactly where they fit."""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from actors.maps.grid_map import GridMap
from common.config import MappingConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Planner, Status
from common.planners.navigation.cell_path import connected
from common.planners.registry import make_planner
from tests.common.planners.clear import clear_space
from tests.common.planners.rollout import Episode, navigate
from tests.plans import Plan, all_plans, diagonal_corridor

NAMES = ["dstar_lite", "astar", "far", "bit_star"]
RESOLUTION = 0.1
PLANS = {plan.world.name: plan for plan in all_plans()}


def planner(name: str, config: MappingConfig) -> Planner:
    if name != "bit_star":
        return make_planner(name, config)
    pytest.importorskip("ompl", reason="OMPL is not installed (extra `planners`)")
    return make_planner(name, config, samples_per_batch=60, batches=1, max_batches=5)


def config_of(radius: float, **changes: Any) -> MappingConfig:
    return MappingConfig(resolution=RESOLUTION, robot_radius=radius, **changes)


def world_of(free: NDArray[np.bool_], start: tuple[float, float], target: tuple[float, float]) -> GridMap:
    return GridMap("drawn", free, RESOLUTION, (0.0, 0.0), start, target, None, (2.0, 2.0))


def two_rooms(door: float) -> GridMap:
    """12 m x 6 m, in the middle a wall with a door that the robot does not see straight on."""
    free = np.zeros((60, 120), dtype=np.bool_)
    free[2:-2, 2:-2] = True
    free[:, 59:61] = False
    free[10 : 10 + round(10 * door), 59:61] = True
    return world_of(free, (2.0, 4.5), (10.0, 4.5))


def arrives(episode: Episode, *, fits: bool) -> None:
    if fits:
        assert episode.complete, (episode.status, episode.reason)
    else:
        assert episode.status is Status.UNREACHABLE, (episode.status, episode.reason)
        assert "target" in episode.reason


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("spacing", [2.0, 4.0])
@pytest.mark.parametrize("door", [0.6, 0.7, 1.0])
@pytest.mark.parametrize("radius", [0.25, 0.4])
def test_doors_let_through_who_fits(name: str, spacing: float, door: float, radius: float) -> None:
    config = config_of(radius, viewpoint_spacing=spacing)
    episode = navigate(planner(name, config), two_rooms(door), config, max_steps=60)
    arrives(episode, fits=door > 2 * radius)
    assert episode.distance < 22.0


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("sensor_range", [6.0, 20.0])
@pytest.mark.parametrize(("plan", "room"), [(name, room) for name, plan in PLANS.items() for room in plan.rooms])
def test_every_room_that_can_be_reached_is(name: str, sensor_range: float, plan: str, room: str) -> None:
    given_plan: Plan = PLANS[plan]
    config = config_of(0.25, sensor_range=sensor_range)
    world = dataclasses.replace(given_plan.world, target=given_plan.rooms[room])
    arrives(navigate(planner(name, config), world, config), fits=room in given_plan.reachable)


@pytest.mark.parametrize("name", NAMES)
def test_a_diagonal_corridor_leads_straight_to_the_target(name: str) -> None:
    world = diagonal_corridor().world
    assert world.target is not None
    episode = navigate(planner(name, config_of(0.25)), world, config_of(0.25))
    assert episode.complete, episode.reason
    assert episode.distance < 1.15 * float(np.hypot(*np.subtract(world.start, world.target)))


@pytest.mark.parametrize("name", NAMES)
def test_a_target_beside_a_wall_is_approached_as_near_as_the_robot_fits(name: str) -> None:
    world = two_rooms(1.0)
    target = (11.75, 0.25)
    config = config_of(0.4)
    mapper = Mapper(config, lattice_origin=world.lattice_origin, target=target)
    mapper.belief.assign(np.where(world.free, np.int8(0), np.int8(100)), world.origin)
    made = planner(name, config)
    made.reset("navigation", target, 0)
    pose = Pose(*world.start)
    for _ in range(20):
        mapper.update(pose)
        plan = made.plan(mapper, pose)
        if plan.waypoint is None:
            break
        for a, b in pairwise([pose.position, *plan.via, plan.waypoint]):
            assert mapper.segment_free(a, b)
        pose = Pose(*plan.waypoint)
    assert plan.status is Status.COMPLETE, plan.reason
    assert pose.distance_to(target) < 0.65


@pytest.mark.parametrize("name", ["dstar_lite", "astar", "far", "bit_star", "nbvp", "dsvp"])
def test_a_robot_that_stands_in_the_margin_leaves_it(name: str) -> None:
    """As after a push, or when a wall turns out to be nearer than it seemed."""
    world = two_rooms(1.0)
    task = "exploration" if name in ("nbvp", "dsvp") else "navigation"
    config = config_of(0.4)
    mapper = Mapper(config, lattice_origin=world.lattice_origin, target=world.target if task == "navigation" else None)
    # The right room is unknown but for what is seen through the door.
    cells = np.where(world.free, np.int8(0), np.int8(100))
    cells[:, 61:] = -1
    mapper.belief.assign(cells, world.origin)
    made = planner(name, config)
    made.reset(task, mapper.target, 0)
    pose = Pose(0.35, 3.0)
    mapper.update(pose)
    plan = made.plan(mapper, pose)
    assert plan.status is Status.GOING, plan.reason
    assert plan.waypoint is not None
    way = [pose.position, *plan.via, plan.waypoint]
    for a, b in pairwise(way):
        assert mapper.segment_free(a, b)
    assert plan.waypoint[0] >= 0.6 - 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_what_no_viewpoint_shows_is_looked_at_more_closely(name: str) -> None:
    """A corridor of 0.8 m that winds inside one square of the lattice: from its viewpoint most of it is hidden."""
    free = np.zeros((44, 44), dtype=np.bool_)
    free[2:42, 2:10] = True
    free[2:10, 10:20] = True
    free[2:40, 12:20] = True
    free[32:40, 20:30] = True
    free[4:40, 22:30] = True
    free[4:12, 30:40] = True
    free[4:40, 32:40] = True
    config = config_of(0.3, viewpoint_spacing=4.0)
    world = dataclasses.replace(world_of(free, (0.6, 3.8), (3.6, 3.6)), lattice_origin=(2.2, 2.2))
    episode = navigate(planner(name, config), world, config, max_steps=80)
    arrives(episode, fits=True)
    assert episode.distance < 25.0


def rooms(random: np.random.Generator) -> NDArray[np.bool_]:
    """Walls with doors of 0.4 to 1 m, and clutter."""
    rows, columns = random.integers(60, 110, 2).tolist()
    free = np.ones((rows, columns), dtype=np.bool_)
    for _ in range(int(random.integers(1, 5))):
        part = free if random.random() < 0.5 else free.T
        place = int(random.integers(8, part.shape[1] - 8))
        part[:, place : place + 2] = False
        for _ in range(int(random.integers(1, 3))):
            door = int(random.integers(4, 11))
            begin = int(random.integers(2, part.shape[0] - 2 - door))
            part[begin : begin + door, place : place + 2] = True
    for _ in range(int(random.integers(0, 6))):
        row, column = int(random.integers(2, rows - 10)), int(random.integers(2, columns - 10))
        height, width = random.integers(1, 10, 2).tolist()
        free[row : row + height, column : column + width] = False
    free[[0, 1, -2, -1], :] = False
    free[:, [0, 1, -2, -1]] = False
    return free


@settings(max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    name=st.sampled_from(["dstar_lite", "astar", "far"]),
    radius=st.sampled_from([0.0, 0.25, 0.4]),
    spacing=st.sampled_from([2.0, 4.0]),
    sensor_range=st.sampled_from([4.0, 20.0]),
)
def test_random_rooms_are_reached_exactly_when_the_robot_fits(
    seed: int, name: str, radius: float, spacing: float, sensor_range: float
) -> None:
    random = np.random.default_rng(seed)
    free = rooms(random)
    _, clear = clear_space(np.where(free, np.int8(0), np.int8(100)), radius / RESOLUTION)
    places = np.flatnonzero(clear.reshape(-1) == 0)
    if not len(places):
        return
    start, goal = (int(places[k]) for k in random.integers(len(places), size=2))
    width = clear.shape[1]
    ends = [((cell % width - 0.5) * RESOLUTION, (cell // width - 0.5) * RESOLUTION) for cell in (start, goal)]
    world = world_of(free, *ends)
    config = config_of(radius, viewpoint_spacing=spacing, sensor_range=sensor_range)
    episode = navigate(planner(name, config), world, config, max_steps=200)
    # Near enough is near enough, behind a wall as well.
    if not episode.complete:
        arrives(episode, fits=connected(clear, start, goal))
    elif not connected(clear, start, goal):
        assert np.hypot(*np.subtract(episode.waypoints[-1], ends[1])) < 1.61
