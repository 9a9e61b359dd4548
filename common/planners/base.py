"""The interface of a planner, which sees what the robot knows and nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol, runtime_checkable

from common.config import MappingConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper

TaskName = str
"""Name of a task, see `common.tasks`."""
Position = tuple[float, float]


class Status(Enum):
    """What a planner says about the task."""

    GOING = "going"
    """There is a waypoint to go to."""
    COMPLETE = "complete"
    """Nothing is left to do as far as the belief tells: no frontier can be observed, or the target is reached."""
    UNREACHABLE = "unreachable"
    """The target cannot be reached through anything that is free or unknown."""
    STUCK = "stuck"
    """The robot has no way to any viewpoint."""


@dataclass(frozen=True, slots=True)
class Plan:
    """One decision.

    Attributes:
        status: what the planner says about the task.
        waypoint: where to go next, metres in the map frame; None unless `status` is GOING. The way there is straight
            but for the corners in `via`; each leg leads through known free space with room for the robot, and is at
            most as long as the longest straight edge of the viewpoint graph (sqrt(5) spacings).
        via: corners of the way to the waypoint, metres; empty where it is straight.
        beacon: the area that the waypoint leads to, metres, where the planner has such a notion.
        path: the route planned beyond the waypoint, metres, for display.
        reason: why the status is what it is, in words for the robot's operator.
    """

    status: Status
    waypoint: Position | None = None
    via: list[Position] = field(default_factory=list)
    beacon: Position | None = None
    path: list[Position] = field(default_factory=list)
    reason: str = ""


class Planner(Protocol):
    """A planner for one or both tasks.

    Usage::

        planner.reset("navigation", target=(40.0, 12.0), seed=7)
        while (plan := planner.plan(mapper, pose)).status is Status.GOING:
            pose = drive_along([*plan.via, plan.waypoint])
    """

    @property
    def name(self) -> str:
        """Name by which commands and results files call it."""
        ...

    @property
    def tasks(self) -> frozenset[TaskName]:
        """Tasks that it can do."""
        ...

    def reset(self, task: TaskName, target: Position | None, seed: int) -> None:
        """Begin an episode: forget everything; equal seeds give equal episodes."""
        ...

    def plan(self, mapper: Mapper, pose: Pose) -> Plan:
        """Decide; the mapper has taken in the newest scan and was updated at this pose."""
        ...


@runtime_checkable
class HasPlanningSet(Protocol):
    """A planner that needs utilities and beacons by rules of its own, such as a policy that was trained with them."""

    def mapping_for(self, task: TaskName) -> MappingConfig:
        """Return the mapping to give it for a task."""
        ...


@runtime_checkable
class HasDeputies(Protocol):
    """A planner that lets others decide in its place where they know better."""

    @property
    def deputies(self) -> Sequence[Planner]:
        """Planners that may decide in its place in this episode; begun with it."""
        ...


def with_deputies(planner: Planner) -> list[Planner]:
    """Return a planner and those that may decide in its place in this episode, theirs included, one of each class."""
    deputies = planner.deputies if isinstance(planner, HasDeputies) else ()
    kinds: dict[type[Planner], Planner] = {type(planner): planner}
    for deputy in deputies:
        for each in with_deputies(deputy):
            kinds.setdefault(type(each), each)
    return list(kinds.values())


def mapping_for(planner: object, task: TaskName, config: MappingConfig) -> MappingConfig:
    """Return the mapping that a planner needs: its own where it has one, else the given."""
    return planner.mapping_for(task) if isinstance(planner, HasPlanningSet) else config
