from __future__ import annotations

import pytest

from common.config import MappingConfig
from common.errors import ConfigError
from common.planners.registry import PLANNERS, make_planner, planner_names, shipped_tasks_of


def test_names_by_task() -> None:
    assert {"nearest", "greedy", "nbvp", "dsvp", "tare", "tour"} <= set(planner_names("exploration"))
    assert {"dstar_lite", "astar", "bit_star", "far"} <= set(planner_names("navigation"))
    assert "hdplanner" in planner_names("exploration")
    assert "hdplanner" in planner_names("navigation")
    assert set(planner_names()) == set(planner_names("exploration")) | set(planner_names("navigation"))


def test_every_name_has_a_summary_and_tasks() -> None:
    for name in planner_names():
        assert PLANNERS.summary(name)
        assert shipped_tasks_of(name)


@pytest.mark.parametrize("name", ["nearest", "greedy", "nbvp", "dsvp", "tour"])
def test_made_planners_carry_their_name_and_tasks(name: str) -> None:
    planner = make_planner(name, MappingConfig())
    assert planner.name == name
    assert planner.tasks == shipped_tasks_of(name)


def test_unknown_name_is_met_with_a_suggestion() -> None:
    with pytest.raises(ConfigError, match="did you mean 'greedy'"):
        make_planner("gredy", MappingConfig())
    with pytest.raises(ConfigError, match="planners are: nearest"):
        make_planner("zzz", MappingConfig())


def test_unknown_setting_is_met_with_a_suggestion() -> None:
    with pytest.raises(ConfigError, match="did you mean 'scale'"):
        make_planner("greedy", MappingConfig(), scal=3.0)
    with pytest.raises(ConfigError, match="it has none"):
        make_planner("nearest", MappingConfig(), scale=3.0)


def test_settings_reach_the_planner() -> None:
    with pytest.raises(ConfigError, match="must be above 0"):
        make_planner("greedy", MappingConfig(), scale=-1.0)
    with pytest.raises(ConfigError, match="nodes"):
        make_planner("nbvp", MappingConfig(), nodes=1)
    with pytest.raises(ConfigError, match="horizon"):
        make_planner("dsvp", MappingConfig(), horizon=0.0)
