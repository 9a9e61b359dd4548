import dataclasses

import numpy as np
import pytest

from actors.environment import Environment
from actors.evaluation.episode import run_episode
from actors.evaluation.pixels import to_metres, to_pixels
from actors.evaluation.recount import recount
from actors.evaluation.results import Results
from actors.maps.sources import open_sources
from actors.simulators.grid import GridSimulator
from actors.tasks import make_goal
from common.config import RewardConfig
from common.planners.exploration.greedy import GreedyPlanner
from tests.actors.evaluation.small import MAPS, results, settings

SETTINGS = settings()
WORLD = open_sources([MAPS], 0.25, "exploration").world(0)


@pytest.fixture(scope="module")
def recorded() -> Results:
    simulator = GridSimulator(SETTINGS.simulator, 20.0)
    environment = Environment(simulator, SETTINGS.mapping, make_goal(SETTINGS.task), RewardConfig(), 128)
    outcome = run_episode(environment, GreedyPlanner(SETTINGS.mapping), WORLD, seed=0, time_limit=60.0)
    assert outcome.success
    return results().model_copy(update={"episodes": [outcome.result(WORLD.name)]})


def changed(recorded, **values):
    return recorded.episodes[0].model_copy(update=values)


def test_pixels_count_from_the_centre_of_the_top_left_one():
    rows = WORLD.free.shape[0]
    assert to_pixels(WORLD, (0.125, rows * 0.25 - 0.125)) == pytest.approx((0.0, 0.0))
    assert to_pixels(WORLD, (1.0, 1.0)) == pytest.approx((3.5, rows - 4.5))
    assert to_metres(WORLD, to_pixels(WORLD, (3.21, 7.6))) == pytest.approx((3.21, 7.6))


def test_an_honest_record_agrees(recorded):
    counted = recount(recorded, recorded.episodes[0], WORLD, SETTINGS)
    assert counted.problems == ()
    assert counted.success
    assert counted.distance == pytest.approx(recorded.episodes[0].distance_m, abs=1e-3)


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({"distance_m": 1.0}, "distance_m"),
        ({"steps": 1}, "steps"),
        ({"success": False}, "success"),
        ({"explored_rate": 0.5}, "explored_rate"),
    ],
)
def test_each_wrong_figure_is_found(recorded, values, word):
    counted = recount(recorded, changed(recorded, **values), WORLD, SETTINGS)
    assert len(counted.problems) == 1
    assert counted.problems[0].startswith(word)


def test_a_leap_a_wall_and_a_wrong_start_are_found(recorded):
    route = recorded.episodes[0].waypoints
    leap = recount(recorded, changed(recorded, waypoints=[route[0], *route[3:]]), WORLD, SETTINGS).problems
    assert any("long" in problem for problem in leap)
    blocked = np.argwhere(~WORLD.free)[0]
    wall = [*route[:2], (float(blocked[1]), float(WORLD.free.shape[0] - 1 - blocked[0]))]
    assert any(
        "occupied" in problem
        for problem in recount(recorded, changed(recorded, waypoints=wall), WORLD, SETTINGS).problems
    )
    moved = dataclasses.replace(WORLD, start=(WORLD.start[0] + 4.0, WORLD.start[1]))
    assert any("start" in problem for problem in recount(recorded, recorded.episodes[0], moved, SETTINGS).problems)


def test_driving_on_after_the_end_is_found(recorded):
    route = recorded.episodes[0].waypoints
    problems = recount(recorded, changed(recorded, waypoints=[*route, route[-2]]), WORLD, SETTINGS).problems
    assert any("complete at waypoint" in problem for problem in problems)
