"""Tasks: what a robot is to do. A `Task` owns all that differs between them; the rest of the code asks it.

A task of one's own is a variation of a shipped one, in one module::

    from dataclasses import replace
    from hdplanner import EXPLORATION, ExplorationGoal

    class HalfGoal(ExplorationGoal):
        def complete(self, coverage, pose):
            return coverage.explored >= 0.5

    HALF = replace(EXPLORATION, name="half", summary="see half of what can be reached", goal=HalfGoal, expert=None)

Then ``my_module:HALF``, or the name of an entry point of the group ``hdplanner.tasks``, is the name of a task.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any, Final

from common.errors import ConfigError
from common.ids import check_id
from common.registry import Entry, Registry, load_path


@dataclass(frozen=True, slots=True)
class Task:
    """What differs between tasks.

    Attributes:
        name: in configurations, reports and results. Lower-case letters, digits and dashes.
        summary: one line for listings.
        needs_target: the robot is given the position of a target in advance; else it sees what it can reach.
        plan_as: what planners that do not know the task are asked for: `exploration` or `navigation`.
        reference: classical planner whose route a policy of the features `guided` sees, and which decides where a
            shipped policy does not.
        in_the_open: classical planner that decides instead of `reference` in the open, as in forests, where a shipped
            policy does not.
        fallback: classical planner that relieves another one on a robot.
        goal: judges episodes on the true map; called with a `TaskConfig` and this task, it returns an
            `actors.tasks.Goal`. Or its MODULE:NAME, so that a robot need not import it.
        expert: privileged expert for imitation and for privileged rewards; called with a `TaskConfig` and a
            `MappingConfig`, it returns an `actors.expert.Expert`. Or its MODULE:NAME, or None where there is none.
        with_radius: classical planner that decides instead of a shipped policy for a robot that has a radius; none when
            not given.
    """

    name: str
    summary: str
    needs_target: bool
    plan_as: str
    reference: str
    in_the_open: str
    fallback: str
    goal: str | Callable[..., Any]
    expert: str | Callable[..., Any] | None = None
    with_radius: str | None = None

    def __post_init__(self) -> None:
        """Raise ConfigError for a name that cannot be part of a file name or of a report."""
        try:
            check_id(self.name, "the name of a task")
        except ValueError as error:
            raise ConfigError(str(error)) from None

    def asked_of(self, planner: str, does: Collection[str]) -> str:
        """Return the name by which a planner is asked for this task: its own where the planner knows it.

        Args:
            planner: its name, for the message.
            does: names of the tasks that it can do.

        Raises:
            ConfigError: it can do neither this task nor `plan_as`.
        """
        for name in (self.name, self.plan_as):
            if name in does:
                return name
        raise ConfigError(
            f"planner {planner!r} does {' and '.join(sorted(does)) or 'nothing'}, not {self.name}: choose another "
            "planner or task"
        )

    def part(self, name: str) -> Callable[..., Any]:
        """Return the factory of ``goal`` or ``expert``, imported now where it is given by name.

        Raises:
            ConfigError: the task has none, or it cannot be imported.
        """
        factory = getattr(self, name)
        if factory is None:
            raise ConfigError(
                f"task {self.name!r} has no {name}: set cloning.updates=0, cloning.anchor_weight=0 and "
                "reward.kind=paper, or give the task one"
            )
        return load_path(factory) if isinstance(factory, str) else factory


EXPLORATION: Final = Task(
    name="exploration",
    summary="see everything that can be reached",
    needs_target=False,
    plan_as="exploration",
    reference="tour",
    in_the_open="greedy",
    fallback="nearest",
    goal="actors.tasks.exploration:ExplorationGoal",
    expert="actors.expert.exploration:make_expert",
)

NAVIGATION: Final = Task(
    name="navigation",
    summary="reach a target whose position is given and whose surroundings are unknown",
    needs_target=True,
    plan_as="navigation",
    reference="dstar_lite",
    in_the_open="dstar_lite",
    fallback="astar",
    goal="actors.tasks.navigation:NavigationGoal",
    expert="actors.expert.navigation:make_expert",
    # Its ways bend at corners instead of viewpoints. Without a radius they lead along walls (docs/large_scale.md).
    with_radius="far",
)

BOTH: Final = (EXPLORATION, NAVIGATION)
"""The tasks of a run with `both_tasks`."""

TASKS: Final = Registry(
    "task",
    "hdplanner.tasks",
    {
        "exploration": Entry("common.tasks:EXPLORATION", EXPLORATION.summary),
        "navigation": Entry("common.tasks:NAVIGATION", NAVIGATION.summary),
    },
)
"""All tasks by name."""

# Tasks by the names that they were asked for, and by their own: reports and planners call them by these.
_loaded: dict[str, Task] = {}


def find_task(name: str) -> Task:
    """Return a task by its name, or by MODULE:CLASS; one that was loaded so is found by its own name from then on.

    Raises:
        ConfigError: there is no such task, it is no `Task`, or its name is that of another one.
    """
    if name in _loaded:
        return _loaded[name]
    task = TASKS.load(name)
    if not isinstance(task, Task):
        raise ConfigError(
            f"{name!r} is no task: expected a common.tasks.Task, got an object of type {type(task).__name__}"
        )
    if task.name != name:
        known = _loaded.get(task.name) or (find_task(task.name) if task.name in TASKS.names() else task)
        if known != task:
            raise ConfigError(f"task {name!r} calls itself {task.name!r}, which is another task: rename it")
    _loaded[name] = _loaded[task.name] = task
    return task
