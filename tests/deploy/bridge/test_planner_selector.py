"""The planners of a robot: those that ship, and those that somebody adds."""

import sys

import pytest

from common.errors import ConfigError
from deploy.bridge.mission import Phase
from deploy.bridge.planner_selector import make_planners
from tests.common.planners.worlds import ROOMS
from tests.deploy.bridge.offline import Trial, ended, settings

OWN = """
from dataclasses import replace
from common.planners.exploration.greedy import GreedyPlanner
from common.tasks import EXPLORATION

class Own(GreedyPlanner):
    name = "own"
    asked = []
    def reset(self, task, target, seed):
        self.asked.append(task)
        super().reset(task, target, seed)

class Broken:
    def __init__(self, config): pass

WATCH = replace(EXPLORATION, name="watch", fallback="greedy")
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    (tmp_path / "own_robot.py").write_text(OWN)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr("common.tasks._loaded", {})
    yield "own_robot"
    sys.modules.pop("own_robot", None)


def test_a_planner_and_a_task_of_ones_own_drive_a_robot(module):
    config = settings(decision={"planner": f"{module}:Own", "task": f"{module}:WATCH"})
    trial = Trial(ROOMS, config)
    trial.mission.start()
    outcome = trial.run(300, ended)
    assert outcome.orders.phase is Phase.FINISHED
    assert trial.distance > 10.0
    assert {each.planner for each in trial.outcomes} == {"own"}
    assert trial.mission.task.name == "watch"
    # It knows nothing of the task, so it is asked for what the task is like.
    assert set(sys.modules[module].Own.asked) == {"exploration"}
    # The task says who relieves.
    trial.planners.relieve(trial.now, "a test")
    assert trial.planners.in_charge(trial.now).name == "greedy"


@pytest.mark.parametrize(
    ("fallback", "words"),
    [
        ("nearest", "planner nearest begins anew: stuck"),
        ("tour", "planner nearest is relieved by tour for 30 s"),
    ],
)
def test_a_planner_does_not_relieve_itself_in_words(fallback, words, caplog):
    planners = make_planners(settings(decision={"planner": "nearest", "fallback": fallback}))
    planners.begin("exploration", None)
    planners.relieve(0.0, "stuck")
    assert words in caplog.text


def test_planners_that_cannot_be_had_are_named_before_the_robot_moves(module):
    with pytest.raises(ConfigError, match=r"decision\.planner: there is no planner 'gredy' \(did you mean"):
        settings(decision={"planner": "gredy"})
    with pytest.raises(ConfigError, match=r"decision\.fallback: there is no planner 'narest'"):
        settings(decision={"fallback": "narest"})
    with pytest.raises(ConfigError, match=r"decision\.task: there is no task 'explore'"):
        settings(decision={"task": "explore"})
    with pytest.raises(ConfigError, match=r"is no planner, it has no name, tasks, reset, plan"):
        make_planners(settings(decision={"planner": f"{module}:Broken"}))
    with pytest.raises(ConfigError, match="'greedy' does exploration, not navigation"):
        make_planners(settings(decision={"planner": "greedy", "task": "navigation"}))
    with pytest.raises(ConfigError, match="'own' does exploration, not navigation"):
        make_planners(settings(decision={"planner": f"{module}:Own", "task": "navigation"}))
