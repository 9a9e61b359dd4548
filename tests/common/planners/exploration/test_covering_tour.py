"""What the covering tour goes to, what waits, and what is taken along."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from actors.maps.generators import make_generator
from common.config import MappingConfig
from common.errors import ConfigError
from common.planners.base import Position, Status
from common.planners.registry import make_planner
from tests.common.planners.rollout import drawn, explore
from tests.common.planners.worlds import CONFIG, looked

# Side ways of 4 m next to the start and on the way, and a wide hall at the far end of the corridor.
HALL = drawn(
    [
        "####################",
        "##.###.###.........#",
        "##.###.###.........#",
        "##.###.###.........#",
        "#.S................#",
        "##########.........#",
        "##########.........#",
        "##########.........#",
        "####################",
    ]
)


def _first_decision(seen_to: int, **settings: float) -> Position:
    """Where the robot goes that has seen the corridor up to some metres, and has come back to its start."""
    x, y = HALL.start
    mapper, pose = looked(HALL, [(x + step, y) for step in [*range(0, seen_to + 1, 4), *range(seen_to - 4, -1, -4)]])
    plan = make_planner("tour", CONFIG, **settings).plan(mapper, pose)
    assert plan.waypoint is not None
    return plan.waypoint[0] - x, plan.waypoint[1] - y


def test_a_remainder_beside_the_start_is_seen_before_the_robot_leaves() -> None:
    # The side way begins at the start itself: one step up shows it whole.
    assert _first_decision(28, min_frontier=4) == pytest.approx((0.0, 4.0))


def test_what_is_too_small_waits_unless_it_lies_on_the_way() -> None:
    waiting = _first_decision(28, min_frontier=32, detour=0.0)
    assert waiting[0] > 0.0
    assert waiting[1] == pytest.approx(0.0)
    assert _first_decision(28, min_frontier=32, detour=9.0) == pytest.approx((0.0, 4.0))


def test_what_can_show_little_waits_as_well() -> None:
    # From the mouth of a side way 86 m2 of unknown area can be in sight, from the hall 219 m2.
    assert _first_decision(28, min_frontier=4, min_gain=150.0, detour=0.0)[1] == pytest.approx(0.0)
    assert _first_decision(28, min_frontier=4, min_gain=4.0, detour=0.0) == pytest.approx((0.0, 4.0))


def test_of_what_waits_the_room_behind_a_narrow_gap_comes_before_the_slivers() -> None:
    # All frontiers are too small, and the hall could show most.
    hall = _first_decision(28, min_frontier=1000, min_hidden=150.0, detour=0.0)
    assert hall[0] > 0.0
    assert hall[1] == pytest.approx(0.0)
    assert _first_decision(28, min_frontier=1000, min_hidden=1000.0, detour=0.0) == pytest.approx((0.0, 4.0))


def test_a_gap_that_is_too_small_for_a_door_is_seen_in_passing_however_much_it_could_hide() -> None:
    beside = _first_decision(28, min_frontier=1000, min_hidden=150.0, min_door=1000, detour=0.0)
    assert beside == pytest.approx((0.0, 4.0))


def test_what_waits_is_explored_in_the_end() -> None:
    planner = make_planner("tour", CONFIG, min_frontier=48, min_gain=300.0, detour=0.0)
    episode = explore(planner, HALL, CONFIG, unseen_area=-1.0)
    assert episode.status is Status.COMPLETE
    assert episode.explored > 0.99


@settings(max_examples=6, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(
    seed=st.integers(0, 10_000),
    spacing=st.sampled_from([2.0, 4.0]),
    detour=st.sampled_from([0.0, 2.0, 10.0]),
    min_gain=st.sampled_from([0.0, 2.0, 100.0]),
    most_openings=st.sampled_from([0.0, 3.0, 100.0]),
)
def test_every_world_comes_to_an_end(
    seed: int, spacing: float, detour: float, min_gain: float, most_openings: float
) -> None:
    world = make_generator("rooms", {"width": "320", "height": "240"}).world(seed, 0.25)
    config = MappingConfig(resolution=0.5, sensor_range=12.0, viewpoint_spacing=spacing, beacon_range=12.0)
    planner = make_planner("tour", config, detour=detour, min_gain=min_gain, most_openings=most_openings)
    # Nothing is ever enough: the planner itself has to end the episode.
    episode = explore(planner, world, config, unseen_area=-1.0, max_steps=400, rays=180)
    assert episode.status is Status.COMPLETE, episode.reason
    assert episode.explored > 0.9


def test_decisions_depend_on_what_is_known_alone() -> None:
    planner = make_planner("tour", CONFIG)
    first = explore(planner, HALL, CONFIG, seed=1)
    assert explore(planner, HALL, CONFIG, seed=2).waypoints == first.waypoints


def test_aisles_are_passed_and_not_looked_into_one_by_one() -> None:
    world = make_generator("warehouse", {"width": "320", "height": "240"}).world(1_000_003, 0.25)
    config = MappingConfig(resolution=0.5, robot_radius=0.25)
    way = [
        explore(make_planner("tour", config, most_openings=most), world, config).distance for most in (3.0, math.inf)
    ]
    assert way[0] < 0.9 * way[1]


@pytest.mark.parametrize(
    "setting",
    ["cover_range", "min_frontier", "min_remainder", "min_gain", "min_hidden", "min_door", "detour", "most_openings"],
)
@pytest.mark.parametrize("value", [-1.0, np.nan])
def test_settings_that_do_not_work_are_refused(setting: str, value: float) -> None:
    with pytest.raises(ConfigError, match=setting):
        make_planner("tour", CONFIG, **{setting: value})
