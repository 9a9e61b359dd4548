"""Worlds without a happy end, for every planner of the registry: a clear status, and never an endless loop."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actors.maps.grid_map import GridMap
from common.config import MappingConfig, NetworkConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.network.parameters import initial_parameters
from common.planners.base import Planner, Status, TaskName
from common.planners.registry import make_planner, planner_names
from common.policies.policy_file import PolicyCard, write_policy
from tests.common.planners.rollout import drawn, explore, navigate

CONFIG = MappingConfig(resolution=0.5, sensor_range=10.0, beacon_range=10.0)
NETWORK = NetworkConfig(width=16, heads=2, layers=1)
TASKS: tuple[TaskName, TaskName] = ("exploration", "navigation")
EXPLORERS, NAVIGATORS = (planner_names(task) for task in TASKS)
NEEDS = {"tare": "ortools", "bit_star": "ompl"}
LEARNED = {"hdplanner", "hdplanner-bare"}
# Enough for small worlds.
FAST = {"bit_star": {"samples_per_batch": 60, "batches": 1, "max_batches": 30}}
STEPS = 60

ROOM = ["########", "#S.....#", "#.....T#", "########"]
# The robot starts at the closed end of a corridor.
DEAD_END = ["##########", "#S####...#", "#.####.#T#", "#......###", "##########"]
# A target in a chamber without a door.
SEALED = ["###########", "#.........#", "#.S...###.#", "#.....#T#.#", "#.....###.#", "#.........#", "###########"]
IN_A_WALL = [row.replace("T", "t") for row in SEALED]
# The robot itself is in a chamber without a door: one viewpoint, or a few.
CLOSED_IN = ["########", "#S#...T#", "###....#", "########"]
CHAMBER = ["########", "#S.#..T#", "#..#...#", "########"]


@pytest.fixture(scope="module")
def policies(tmp_path_factory: pytest.TempPathFactory) -> dict[TaskName, Path]:
    """Policies that were never trained: the worst that a planner could be given."""
    made: dict[TaskName, Path] = {}
    for task in TASKS:
        path = tmp_path_factory.mktemp(task) / "policy.safetensors"
        write_policy(
            path, initial_parameters(NETWORK, 0), PolicyCard("t", task, NETWORK, CONFIG, 1, 0, 0, False, "", "")
        )
        made[task] = path
    return made


def make(name: str, task: TaskName, policies: dict[TaskName, Path]) -> Planner:
    if name in NEEDS:
        pytest.importorskip(NEEDS[name], reason="the extra `planners` is not installed")
    settings: dict[str, Any] = {"policy": policies[task]} if name in LEARNED else FAST.get(name, {})
    return make_planner(name, CONFIG, **settings)


@pytest.mark.parametrize("name", EXPLORERS)
@pytest.mark.parametrize("rows", [ROOM, DEAD_END, SEALED, CLOSED_IN, CHAMBER])
def test_exploration_ends(name: str, rows: list[str], policies: dict[TaskName, Path]) -> None:
    episode = explore(make(name, "exploration", policies), drawn(rows), CONFIG, unseen_area=-1.0, max_steps=STEPS)
    if name in LEARNED and episode.status is Status.GOING:
        # An untrained network may be slow, or circle without the rule against revisits: whoever runs it counts.
        assert episode.steps == STEPS
        return
    assert episode.status in (Status.COMPLETE, Status.STUCK), episode.reason
    assert episode.reason
    assert episode.explored > 0.98


@pytest.mark.parametrize("name", [name for name in EXPLORERS if name not in LEARNED])
def test_exploration_by_a_robot_that_stops_short(name: str, policies: dict[TaskName, Path]) -> None:
    """The longest edges of the lattice are a little too long for it, and its own viewpoint too near to drive to."""
    world = drawn(["########", "#S.....#", "#####..#", "#......#", "#......#", "########"])
    episode = explore(make(name, "exploration", policies), world, CONFIG, unseen_area=4.0, max_steps=STEPS, slack=0.15)
    assert episode.complete, episode.reason
    assert episode.distance < 80.0


@pytest.mark.parametrize("name", [name for name in NAVIGATORS if name not in LEARNED])
def test_navigation_by_a_robot_that_stops_short(name: str, policies: dict[TaskName, Path]) -> None:
    episode = navigate(make(name, "navigation", policies), drawn(DEAD_END), CONFIG, slack=0.15)
    assert episode.complete, episode.reason
    assert episode.distance <= 60.0


@pytest.mark.parametrize("name", [name for name in EXPLORERS if name != "hdplanner-bare"])
def test_a_frontier_that_no_scan_resolves_holds_nobody_forever(name: str, policies: dict[TaskName, Path]) -> None:
    """As over a drop: the belief promises something there, and no scan ever tells more."""
    world = drawn(["########", "#S.....#", "#......#", "#......#", "########"])
    cells = np.where(world.free, np.int8(0), np.int8(100))
    cells[-14:-9, 34:40] = -1
    mapper = Mapper(CONFIG, lattice_origin=world.lattice_origin)
    mapper.belief.assign(cells, world.origin)
    pose = Pose(*world.start)
    planner = make(name, "exploration", policies)
    planner.reset("exploration", None, 0)
    for _ in range(10 * STEPS):
        mapper.update(pose)
        plan = planner.plan(mapper, pose)
        if plan.waypoint is None:
            break
        pose = Pose(*plan.waypoint)
    assert plan.status is Status.COMPLETE
    assert plan.reason


@pytest.mark.parametrize("name", EXPLORERS)
def test_exploration_of_a_known_world_is_complete_at_once(name: str, policies: dict[TaskName, Path]) -> None:
    mapper, pose = known(dataclasses.replace(drawn(DEAD_END), target=None))
    planner = make(name, "exploration", policies)
    planner.reset("exploration", None, 0)
    plan = planner.plan(mapper, pose)
    assert plan.status is Status.COMPLETE
    assert plan.waypoint is None
    assert plan.reason


@pytest.mark.parametrize("name", NAVIGATORS)
@pytest.mark.parametrize("rows", [SEALED, IN_A_WALL, CLOSED_IN, CHAMBER])
def test_a_target_out_of_reach_is_said_to_be_so(name: str, rows: list[str], policies: dict[TaskName, Path]) -> None:
    episode = navigate(make(name, "navigation", policies), drawn(rows), CONFIG, max_steps=STEPS)
    if name in LEARNED and episode.status is Status.GOING:
        assert episode.steps == STEPS
        return
    assert episode.status is Status.UNREACHABLE, (episode.status, episode.reason)
    assert episode.reason
    assert not episode.complete


@pytest.mark.parametrize("name", [name for name in NAVIGATORS if name not in LEARNED])
@pytest.mark.parametrize(("rows", "longest"), [(ROOM, 22.0), (DEAD_END, 60.0)])
def test_a_target_in_reach_is_reached(
    name: str, rows: list[str], longest: float, policies: dict[TaskName, Path]
) -> None:
    episode = navigate(make(name, "navigation", policies), drawn(rows), CONFIG)
    assert episode.complete, episode.reason
    assert episode.distance <= longest


@pytest.mark.parametrize("name", NAVIGATORS)
def test_a_target_out_of_reach_in_a_known_world_is_said_at_once(name: str, policies: dict[TaskName, Path]) -> None:
    mapper, pose = known(drawn(SEALED))
    planner = make(name, "navigation", policies)
    planner.reset("navigation", mapper.target, 0)
    plan = planner.plan(mapper, pose)
    assert plan.status is Status.UNREACHABLE
    assert plan.waypoint is None
    assert plan.reason


@pytest.mark.parametrize(("name", "task"), [(name, task) for task in TASKS for name in planner_names(task)])
def test_a_robot_in_an_obstacle_is_stuck(name: str, task: TaskName, policies: dict[TaskName, Path]) -> None:
    """As after a jump of the localisation."""
    world = drawn(IN_A_WALL)
    assert world.target is not None
    mapper, _ = known(dataclasses.replace(world, target=world.start if task == "navigation" else None))
    pose = Pose(*world.target)
    mapper.update(pose)
    planner = make(name, task, policies)
    planner.reset(task, mapper.target, 0)
    plan = planner.plan(mapper, pose)
    assert plan.status is Status.STUCK
    assert plan.waypoint is None
    assert plan.reason


def known(world: GridMap) -> tuple[Mapper, Pose]:
    """Return a mapper that knows all of a world, and the pose at its start."""
    mapper = Mapper(CONFIG, lattice_origin=world.lattice_origin, target=world.target)
    mapper.belief.assign(np.where(world.free, np.int8(0), np.int8(100)), world.origin)
    pose = Pose(*world.start)
    mapper.update(pose)
    return mapper, pose
