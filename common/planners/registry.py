"""All planners by name; each is imported only when it is asked for."""

from __future__ import annotations

import difflib
import inspect
from dataclasses import dataclass
from importlib import import_module
from typing import Any, cast

from common.config.schema import MappingConfig
from common.errors import ConfigError
from common.planners.base import Planner, TaskName


@dataclass(frozen=True, slots=True)
class Entry:
    """Where a planner lives.

    Attributes:
        module: full name of its module.
        factory: a class or function in it, called as ``factory(config, **settings)``.
        tasks: tasks that it can do.
        summary: one line for listings.
    """

    module: str
    factory: str
    tasks: frozenset[TaskName]
    summary: str


_EXPLORATION: frozenset[TaskName] = frozenset({"exploration"})
_NAVIGATION: frozenset[TaskName] = frozenset({"navigation"})
_BOTH: frozenset[TaskName] = _EXPLORATION | _NAVIGATION

_ENTRIES: dict[str, Entry] = {
    "nearest": Entry("common.planners.nearest", "NearestPlanner", _EXPLORATION, "nearest frontier (Yamauchi 1997)"),
    "greedy": Entry("common.planners.greedy", "GreedyPlanner", _EXPLORATION, "utility x exp(-path length / scale)"),
    "nbvp": Entry("common.planners.nbvp", "NbvpPlanner", _EXPLORATION, "receding-horizon RRT (Bircher 2016)"),
    "dsvp": Entry("common.planners.dsvp", "DsvpPlanner", _EXPLORATION, "local RRT and global graph (Zhu 2021)"),
    "tare": Entry("common.planners.tare", "TarePlanner", _EXPLORATION, "local coverage and global tour (Cao 2021)"),
    "tour": Entry(
        "common.planners.covering_tour", "CoveringTourPlanner", _EXPLORATION, "covering tour over all frontiers"
    ),
    "dstar_lite": Entry("common.planners.dstar_lite", "DStarLitePlanner", _NAVIGATION, "D* Lite (Koenig 2002)"),
    "astar": Entry("common.planners.astar", "AStarPlanner", _NAVIGATION, "A*, planned anew at each step"),
    "bit_star": Entry("common.planners.bit_star", "BitStarPlanner", _NAVIGATION, "BIT* through OMPL (Gammell 2015)"),
    "far": Entry("common.planners.far", "FarPlanner", _NAVIGATION, "incremental visibility graph (Yang 2022)"),
    "hdplanner": Entry("common.planners.learned", "LearnedPlanner", _BOTH, "a trained policy (Liang 2025)"),
    "hdplanner-bare": Entry(
        "common.planners.learned", "bare_planner", _BOTH, "a trained policy without rule and guard"
    ),
}


def planner_names(task: TaskName | None = None) -> list[str]:
    """Return the names of all planners, or of those that can do a task, in the order of listings."""
    return [name for name, entry in _ENTRIES.items() if task is None or task in entry.tasks]


def planner_summary(name: str) -> str:
    """Return one line about a planner; ConfigError for an unknown name."""
    return _entry(name).summary


def planner_tasks(name: str) -> frozenset[TaskName]:
    """Return the tasks that a planner can do, without importing it; ConfigError for an unknown name."""
    return _entry(name).tasks


def make_planner(name: str, config: MappingConfig, **settings: Any) -> Planner:
    """Make a planner.

    Args:
        name: one of `planner_names`.
        config: the mapping that the planner will be given.
        settings: keyword arguments of the planner's constructor.

    Raises:
        ConfigError: there is no planner of that name, the planner has no such setting, or a package that it needs is
            missing (the message names the extra to install).
    """
    entry = _entry(name)
    factory = getattr(import_module(entry.module), entry.factory)
    known = [
        parameter.name
        for parameter in inspect.signature(factory).parameters.values()
        if parameter.name != "config" and parameter.kind is not inspect.Parameter.VAR_KEYWORD
    ]
    for setting in settings:
        if setting not in known:
            offer = f"its settings are: {', '.join(known)}" if known else "it has none"
            raise ConfigError(f"planner {name!r} has no setting {setting!r}{_did_you_mean(setting, known)}; {offer}")
    return cast(Planner, factory(config, **settings))


def _entry(name: str) -> Entry:
    if name not in _ENTRIES:
        names = planner_names()
        raise ConfigError(f"there is no planner {name!r}{_did_you_mean(name, names)}; planners are: {', '.join(names)}")
    return _ENTRIES[name]


def _did_you_mean(word: str, known: list[str]) -> str:
    close = difflib.get_close_matches(word.lower(), known, n=1, cutoff=0.5)
    return f" (did you mean {close[0]!r}?)" if close else ""
