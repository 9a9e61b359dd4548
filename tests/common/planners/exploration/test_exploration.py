"""What every exploration planner must do, on small worlds."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from actors.maps.grid_map import GridMap
from common.config import MappingConfig
from common.errors import ConfigError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Status
from common.planners.registry import make_planner
from tests.common.planners.rollout import explore
from tests.common.planners.worlds import ARMS, CONFIG, DEAD_END, ROOM, ROOMS, looked

NAMES = ["nearest", "greedy", "nbvp", "dsvp", "tare", "tour"]

pytestmark = pytest.mark.parametrize("name", NAMES)


@pytest.fixture(autouse=True)
def _needs_ortools(name: str) -> None:
    if name == "tare":
        pytest.importorskip("ortools")


@pytest.mark.parametrize("world", [DEAD_END, ARMS, ROOMS], ids=["dead end", "arms", "rooms"])
def test_explores_small_worlds_whole(name: str, world: GridMap) -> None:
    # explore() checks that every waypoint is known to be free, in line of sight and one edge away.
    episode = explore(make_planner(name, CONFIG), world, CONFIG, unseen_area=2.0)
    assert episode.complete, episode.reason
    assert episode.steps <= 128


def test_ends_by_itself_when_all_is_seen(name: str) -> None:
    episode = explore(make_planner(name, CONFIG), ROOMS, CONFIG, unseen_area=-1.0)
    assert episode.status is Status.COMPLETE
    assert episode.reason
    assert episode.explored > 0.98


def test_one_room_is_complete_at_once(name: str) -> None:
    mapper, pose = looked(ROOM)
    plan = make_planner(name, CONFIG).plan(mapper, pose)
    assert plan.status is Status.COMPLETE
    assert plan.waypoint is None
    assert plan.reason


def test_knows_nothing(name: str) -> None:
    mapper = Mapper(CONFIG, lattice_origin=(0.0, 0.0))
    mapper.update(Pose(1.0, 1.0))
    plan = make_planner(name, CONFIG).plan(mapper, Pose(1.0, 1.0))
    assert plan.status is Status.STUCK
    assert plan.waypoint is None
    assert plan.reason


def test_robot_beside_the_lattice(name: str) -> None:
    x, y = ROOMS.start
    mapper, pose = looked(ROOMS, [(x + 1.1, y - 0.7)])
    plan = make_planner(name, CONFIG).plan(mapper, pose)
    assert plan.status is Status.GOING
    assert plan.waypoint is not None
    assert 0.0 < pose.distance_to(plan.waypoint) <= np.sqrt(5.0) * CONFIG.viewpoint_spacing + 1e-6
    assert mapper.segment_free(pose.position, plan.waypoint)


def test_equal_seeds_give_equal_episodes(name: str) -> None:
    planner = make_planner(name, CONFIG)
    first = explore(planner, ROOMS, CONFIG, seed=3)
    explore(planner, ARMS, CONFIG, seed=4)
    assert explore(planner, ROOMS, CONFIG, seed=3).waypoints == first.waypoints


def test_path_goes_on_from_the_waypoint(name: str) -> None:
    mapper, pose = looked(ARMS)
    plan = make_planner(name, CONFIG).plan(mapper, pose)
    assert plan.waypoint is not None
    places = [pose.position, plan.waypoint, *plan.path]
    assert all(mapper.segment_free(a, b) for a, b in pairwise(places))
    assert plan.beacon in places


def test_refuses_navigation(name: str) -> None:
    with pytest.raises(ConfigError, match="exploration"):
        make_planner(name, CONFIG).reset("navigation", (1.0, 1.0), 0)


@pytest.mark.parametrize("spacing", [1.0, 2.5])
def test_other_lattices(name: str, spacing: float) -> None:
    config = MappingConfig(resolution=0.25, sensor_range=8.0, viewpoint_spacing=spacing, beacon_range=8.0)
    episode = explore(make_planner(name, config), DEAD_END, config, unseen_area=2.0)
    assert episode.complete, episode.reason
