"""The front door: what a program of one's own needs of HDPlanner. docs/extending.md shows how.

Names are imported when they are first used, so that a robot needs no simulator, and a script no torch::

    from hdplanner import Mapper, MappingConfig, Pose, Scan, make_planner
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from actors.environment import Environment as Environment
    from actors.evaluation.results import EpisodeResult as EpisodeResult
    from actors.maps.generators.base import Generator as Generator
    from actors.maps.grid_map import GridMap as GridMap
    from actors.maps.sources import open_sources as open_sources
    from actors.simulators.base import Leg as Leg
    from actors.simulators.base import Simulator as Simulator
    from actors.simulators.factory import make_simulator as make_simulator
    from actors.simulators.grid import GridSimulator as GridSimulator
    from actors.tasks import ExplorationGoal as ExplorationGoal
    from actors.tasks import Goal as Goal
    from actors.tasks import NavigationGoal as NavigationGoal
    from common.config import MappingConfig as MappingConfig
    from common.config import RunConfig as RunConfig
    from common.config import SimulatorConfig as SimulatorConfig
    from common.config import TaskConfig as TaskConfig
    from common.config.load import load_config as load_config
    from common.geometry import Pose as Pose
    from common.geometry import Scan as Scan
    from common.mapping.mapper import Mapper as Mapper
    from common.observations.observation import Observation as Observation
    from common.planners.base import Plan as Plan
    from common.planners.base import Planner as Planner
    from common.planners.base import Status as Status
    from common.planners.registry import make_planner as make_planner
    from common.planners.viewpoint_planner import ViewpointPlanner as ViewpointPlanner
    from common.policies.policy import Policy as Policy
    from common.tasks import EXPLORATION as EXPLORATION
    from common.tasks import NAVIGATION as NAVIGATION
    from common.tasks import Task as Task
    from hdplanner.evaluation import evaluate as evaluate
    from hdplanner.policies import load_policy as load_policy

_HOMES: Final = {
    "EXPLORATION": "common.tasks",
    "NAVIGATION": "common.tasks",
    "Environment": "actors.environment",
    "EpisodeResult": "actors.evaluation.results",
    "ExplorationGoal": "actors.tasks",
    "Generator": "actors.maps.generators.base",
    "Goal": "actors.tasks",
    "GridMap": "actors.maps.grid_map",
    "GridSimulator": "actors.simulators.grid",
    "Leg": "actors.simulators.base",
    "Mapper": "common.mapping.mapper",
    "MappingConfig": "common.config",
    "NavigationGoal": "actors.tasks",
    "Observation": "common.observations.observation",
    "Plan": "common.planners.base",
    "Planner": "common.planners.base",
    "Policy": "common.policies.policy",
    "Pose": "common.geometry",
    "RunConfig": "common.config",
    "Scan": "common.geometry",
    "Simulator": "actors.simulators.base",
    "SimulatorConfig": "common.config",
    "Status": "common.planners.base",
    "Task": "common.tasks",
    "TaskConfig": "common.config",
    "ViewpointPlanner": "common.planners.viewpoint_planner",
    "evaluate": "hdplanner.evaluation",
    "load_config": "common.config.load",
    "load_policy": "hdplanner.policies",
    "make_planner": "common.planners.registry",
    "make_simulator": "actors.simulators.factory",
    "open_sources": "actors.maps.sources",
}
"""Module of each name."""

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    """Import a name of the front door when it is first asked for."""
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'hdplanner' has no attribute {name!r}: it has {', '.join(_HOMES)}")
    found = getattr(import_module(home), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    """Return the names of the front door, imported or not."""
    return sorted({*globals(), *_HOMES})
