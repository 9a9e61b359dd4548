"""All planners by name; each is imported only when it is asked for."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, cast

from common.errors import ConfigError, HDError
from common.registry import Entry, Registry, did_you_mean

if TYPE_CHECKING:
    from common.config import MappingConfig
    from common.planners.base import Planner

_MEMBERS: Final = ("name", "tasks", "reset", "plan")


@dataclass(frozen=True, slots=True)
class PlannerEntry(Entry):
    """Where a planner that ships is defined.

    Attributes:
        tasks: names of the tasks that it can do.
    """

    tasks: frozenset[str]


def _entry(path: str, summary: str, *tasks: str) -> PlannerEntry:
    return PlannerEntry(f"common.planners.{path}", summary, frozenset(tasks))


PLANNERS: Final = Registry(
    "planner",
    "hdplanner.planners",
    {
        "nearest": _entry("exploration.nearest:NearestPlanner", "nearest frontier (Yamauchi 1997)", "exploration"),
        "greedy": _entry("exploration.greedy:GreedyPlanner", "utility x exp(-path length / scale)", "exploration"),
        "nbvp": _entry("exploration.nbvp:NbvpPlanner", "receding-horizon RRT (Bircher 2016)", "exploration"),
        "dsvp": _entry("exploration.dsvp:DsvpPlanner", "local RRT and global graph (Zhu 2021)", "exploration"),
        "tare": _entry("exploration.tare:TarePlanner", "local coverage and global tour (Cao 2021)", "exploration"),
        "tour": _entry(
            "exploration.covering_tour:CoveringTourPlanner", "covering tour over all frontiers", "exploration"
        ),
        "dstar_lite": _entry("navigation.dstar_lite:DStarLitePlanner", "D* Lite (Koenig 2002)", "navigation"),
        "astar": _entry("navigation.astar:AStarPlanner", "A*, replanned from scratch at each step", "navigation"),
        "bit_star": _entry("navigation.bit_star:BitStarPlanner", "BIT* through OMPL (Gammell 2015)", "navigation"),
        "far": _entry("navigation.far:FarPlanner", "incremental visibility graph (Yang 2022)", "navigation"),
        "hdplanner": _entry("learned:LearnedPlanner", "a trained policy (Liang 2025)", "exploration", "navigation"),
        "hdplanner-bare": _entry(
            "learned:bare_planner", "a trained policy without rule and guard", "exploration", "navigation"
        ),
    },
)
"""Planners: called with a `MappingConfig` and settings of its own as keywords, each returns a `Planner`."""


def planner_names(*tasks: str) -> list[str]:
    """Return the names of all planners, or of the shipped ones that can do one of some tasks, as listings have them."""
    if not tasks:
        return PLANNERS.names()
    return [name for name in PLANNERS.shipped if not shipped_tasks_of(name).isdisjoint(tasks)]


def shipped_tasks_of(name: str) -> frozenset[str]:
    """Return the names of the tasks that a shipped planner can do, without importing it."""
    entry = PLANNERS.shipped[name]
    assert isinstance(entry, PlannerEntry)
    return entry.tasks


def make_planner(name: str, config: MappingConfig, **settings: Any) -> Planner:
    """Make a planner.

    Args:
        name: one of `planner_names`, or MODULE:CLASS.
        config: the mapping that the planner will be given.
        settings: keyword arguments of the planner's constructor.

    Raises:
        ConfigError: there is no planner of that name, the planner has no such setting, what was made is no planner, or
            a package that it needs is missing (the message names the extra to install).
    """
    factory = PLANNERS.load(name)
    _check_settings(name, factory, settings)
    if name in PLANNERS.shipped:
        return cast("Planner", factory(config, **settings))
    try:
        made = factory(config, **settings)
    except HDError:
        raise
    except Exception as error:
        raise ConfigError(
            f"cannot make planner {name!r} ({type(error).__name__}: {error}): its class is called with a MappingConfig"
        ) from error
    missing = [member for member in _MEMBERS if not hasattr(made, member)]
    if missing:
        raise ConfigError(f"{name!r} is no planner, it has no {', '.join(missing)}: see common.planners.base.Planner")
    return cast("Planner", made)


def _check_settings(name: str, factory: Any, settings: dict[str, Any]) -> None:
    if not settings:
        return
    parameters = inspect.signature(factory).parameters.values()
    known = [
        parameter.name
        for parameter in parameters
        if parameter.name != "config" and parameter.kind is not inspect.Parameter.VAR_KEYWORD
    ]
    for setting in settings:
        if setting not in known:
            offer = f"its settings are: {', '.join(known)}" if known else "it has none"
            raise ConfigError(f"planner {name!r} has no setting {setting!r}{did_you_mean(setting, known)}; {offer}")
