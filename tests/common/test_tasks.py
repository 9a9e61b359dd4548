"""Tasks, shipped ones and others."""

import sys
from dataclasses import replace

import pytest

from common.config import MappingConfig
from common.errors import ConfigError
from common.planners.registry import make_planner, planner_names
from common.tasks import BOTH, EXPLORATION, NAVIGATION, TASKS, find_task

MODULE = """
from dataclasses import replace
from common.tasks import EXPLORATION
HALF = replace(EXPLORATION, name="half", expert=None)
ANOTHER = replace(HALF, summary="the same name again")
FALSE = replace(EXPLORATION, summary="claims to be what ships")
NONE = object()
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    (tmp_path / "own_tasks.py").write_text(MODULE)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr("common.tasks._loaded", {})
    yield "own_tasks"
    sys.modules.pop("own_tasks", None)


def test_the_shipped_tasks_name_planners_that_do_them():
    assert [find_task(name) for name in TASKS.shipped] == list(BOTH)
    for task in BOTH:
        for name in (task.reference, task.in_the_open, task.fallback):
            assert task.asked_of(name, make_planner(name, MappingConfig()).tasks) == task.name
        assert task.reference in planner_names(task.plan_as)
    assert not EXPLORATION.needs_target
    assert NAVIGATION.needs_target


def test_a_planner_is_asked_by_the_name_that_it_knows():
    half = replace(EXPLORATION, name="half")
    assert half.asked_of("tour", {"exploration"}) == "exploration"
    assert half.asked_of("mine", {"exploration", "half"}) == "half"
    with pytest.raises(ConfigError, match="'astar' does navigation, not half"):
        half.asked_of("astar", {"navigation"})


def test_a_task_of_ones_own_is_known_by_its_own_name_once_it_was_loaded(module):
    half = find_task(f"{module}:HALF")
    assert half.name == "half"
    assert find_task("half") is half
    assert find_task(f"{module}:HALF") == half
    with pytest.raises(ConfigError, match="calls itself 'half', which is another task"):
        find_task(f"{module}:ANOTHER")
    with pytest.raises(ConfigError, match="calls itself 'exploration', which is another task"):
        find_task(f"{module}:FALSE")
    with pytest.raises(ConfigError, match="is no task: expected a common.tasks.Task, got an object of type object"):
        find_task(f"{module}:NONE")


def test_a_task_without_an_expert_says_what_to_do(module):
    with pytest.raises(ConfigError, match=r"task 'half' has no expert: set cloning\.updates=0"):
        find_task(f"{module}:HALF").part("expert")


def test_names_are_fit_for_reports_and_files():
    with pytest.raises(ConfigError, match="the name of a task must be 1 to 64"):
        replace(EXPLORATION, name="My Task")
