"""The planners of a robot: the one in charge, the classical one that relieves it, and the one that finds home."""

from __future__ import annotations

import logging
import time
from typing import Any

from common.errors import ConfigError, HDError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Plan, Planner, Position, TaskName, mapping_for
from common.planners.registry import make_planner
from common.system.logs import lasting
from common.tasks import NAVIGATION, find_task
from deploy.config import DeployConfig

log = logging.getLogger(__name__)

HOME_PLANNER = "astar"


class PlannerError(HDError):
    """A planner failed to decide."""


class PlannerSelector:
    """Asks the planner in charge; another takes over for a while when it fails or gets nowhere.

    Usage::

        planners.begin("exploration", None)
        plan = planners.plan(mapper, pose, now)
    """

    def __init__(self, main: Planner, fallback: Planner, home: Planner, relief: float) -> None:
        """Put the planners together.

        Args:
            main: in charge.
            fallback: relieves it.
            home: finds the way back.
            relief: how long a relief lasts, seconds.
        """
        self._main = main
        self._fallback = fallback
        self._home = home
        self._relief = relief
        self._episode: tuple[TaskName, Position | None] | None = None
        self._homing = False
        self._place: Position = (0.0, 0.0)
        self._until = float("-inf")
        self.why_relieved = ""
        """Why the fallback is, or last was, in charge."""

    @property
    def main(self) -> Planner:
        """The planner in charge when nothing is wrong."""
        return self._main

    @main.setter
    def main(self, planner: Planner) -> None:
        """Put another planner in charge; it begins with the episode of this moment."""
        if self._episode is not None:
            _begin(planner, *self._episode)
        self._main = planner

    def members(self, task: TaskName) -> list[tuple[Planner, TaskName]]:
        """Return all planners, each with the task that it will be asked for."""
        both = [(planner, _asked(planner, task)) for planner in (self._main, self._fallback)]
        return [*both, (self._home, NAVIGATION.name)]

    def begin(self, task: TaskName, target: Position | None) -> None:
        """Begin an episode: everybody forgets everything.

        Raises:
            ConfigError: a planner does not do the task, or lacks a target.
        """
        self._episode = (task, target)
        self._homing = False
        self._until = float("-inf")
        _begin(self._main, task, target)
        _begin(self._fallback, task, target)

    def go_to(self, target: Position) -> None:
        """Begin the way to a place that is no part of the task: home, or a target in the midst of an exploration."""
        self._homing = True
        self._place = target
        self._home.reset(NAVIGATION.name, target, 0)

    def begin_anew(self) -> None:
        """Let everybody forget what was found out on the way to the same target."""
        if self._homing:
            self._home.reset(NAVIGATION.name, self._place, 0)
        elif self._episode is not None:
            _begin(self._main, *self._episode)
            _begin(self._fallback, *self._episode)

    def relieve(self, now: float, why: str) -> None:
        """Put the fallback in charge for a while."""
        if self._homing or self._episode is None:
            return
        name, fallback = self._main.name, self._fallback.name
        what = f"begins anew: {why}" if name == fallback else f"is relieved by {fallback} for {self._relief:g} s: {why}"
        log.warning("planner %s %s", name, what, extra=lasting(lambda: self.relieved(time.monotonic())))
        if now >= self._until:
            _begin(self._fallback, *self._episode)
        self._until = now + self._relief
        self.why_relieved = why

    def relieved(self, now: float) -> bool:
        """Whether the fallback is in charge."""
        return now < self._until and not self._homing

    def in_charge(self, now: float) -> Planner:
        """Return the planner that is asked at this moment."""
        if self._homing:
            return self._home
        return self._fallback if now < self._until else self._main

    def plan(self, mapper: Mapper, pose: Pose, now: float) -> Plan:
        """Decide; the mapper was updated at this pose.

        Raises:
            PlannerError: the planner in charge raised an error; the fallback is in charge from now on.
        """
        planner = self.in_charge(now)
        try:
            return planner.plan(mapper, pose)
        except Exception as error:
            # Whatever a planner's mistake is, a robot on its way must not end with it.
            log.exception("planner %s failed", planner.name, extra=lasting(lambda: self.relieved(time.monotonic())))
            failure = f"planner {planner.name} failed: {type(error).__name__}: {error}"
            self.relieve(now, failure)
            raise PlannerError(failure) from error


def _begin(planner: Planner, task: TaskName, target: Position | None) -> None:
    planner.reset(_asked(planner, task), target, 0)


def _asked(planner: Planner, task: TaskName) -> TaskName:
    return find_task(task).asked_of(planner.name, planner.tasks)


def with_planning_set(config: DeployConfig, planners: PlannerSelector) -> DeployConfig:
    """Return the configuration whose mapping suits the planner in charge: a policy brings rules of its own."""
    mapping = mapping_for(planners.main, _asked(planners.main, config.decision.task), config.mapping)
    return config.model_copy(update={"mapping": mapping})


def make_planners(config: DeployConfig, main: Planner | None = None) -> PlannerSelector:
    """Make the planners that a configuration names.

    Args:
        config: whole tree.
        main: planner in charge, instead of the one that is named.

    Raises:
        ConfigError: there is no such planner, or it does not do the task.
        CheckpointError: a policy cannot be read.
        WeightsError: its weights do not fit its network.
    """
    decision = config.decision
    task = find_task(decision.task)
    settings: dict[str, Any] = {}
    if decision.policy is not None:
        if not decision.planner.startswith("hdplanner"):
            raise ConfigError(
                f"decision.policy is for hdplanner, not {decision.planner!r}: set decision.planner=hdplanner"
            )
        settings["policy"] = decision.policy
    main = main or make_planner(decision.planner, config.mapping, **settings)
    fallback = make_planner(decision.fallback or task.fallback, config.mapping)
    for planner in (main, fallback):
        task.asked_of(planner.name, planner.tasks)
    return PlannerSelector(main, fallback, make_planner(HOME_PLANNER, config.mapping), decision.relief)
