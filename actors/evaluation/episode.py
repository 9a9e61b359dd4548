"""One episode of a planner in a world, in the nominal protocol."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from actors.environment import Environment
from actors.evaluation.pixels import to_pixels
from actors.evaluation.results import PLACES, DecisionTime, EpisodeResult
from actors.maps.grid_map import GridMap
from actors.tasks.coverage import Coverage
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.messages.experience import End
from common.planners.base import Plan, Position, Status, TaskName

COUNTS = ("rule_applied", "guarded")
"""What a planner may count in an episode: decisions of the rule against cycles, and of a guard."""


class Decider(Protocol):
    """What drives an episode: a planner, or the omniscient reference."""

    @property
    def name(self) -> str:
        """Its name."""
        ...

    @property
    def tasks(self) -> frozenset[TaskName]:
        """Names of the tasks that it can do."""
        ...

    def reset(self, task: TaskName, target: Position | None, seed: int) -> None:
        """Begin an episode."""
        ...

    def plan(self, mapper: Mapper, pose: Pose) -> Plan:
        """Decide."""
        ...


@dataclass(frozen=True, slots=True)
class Outcome:
    """How an episode went.

    Attributes:
        waypoints: (x, y) of the start and of every arrival, pixels of the image (see `EpisodeResult`); empty when it
            crashed before its start.
        distance: travelled metres.
        steps: decisions that were carried out.
        success: the task was completed.
        explored: share of the reachable free area that was seen.
        reason: why it ended, in words; what an exploration left unseen, with its area and place, stands in it.
        decision_ms: processor time of every decision, mapping included, milliseconds.
        crashed: the episode did not end by itself: the planner raised an error, or its process ended.
        notes: counts that a planner keeps, such as decisions of the rule against cycles.
        corners: those of the waypoints, by number, at which nothing was decided: corners of ways that are not straight.
        unseen: reachable area that an exploration left unseen although it ended, square metres.
    """

    waypoints: list[Position]
    distance: float
    steps: int
    success: bool
    explored: float
    reason: str
    decision_ms: list[float]
    crashed: bool = False
    notes: dict[str, int] = field(default_factory=dict)
    corners: list[int] = field(default_factory=list)
    unseen: float = 0.0

    def result(self, name: str) -> EpisodeResult:
        """Return the episode as it stands in a results file, under its map's name."""
        times = np.array(self.decision_ms or [0.0])
        return EpisodeResult(
            map=name,
            waypoints=self.waypoints,
            distance_m=round(self.distance, PLACES),
            steps=self.steps,
            success=self.success,
            explored_rate=round(self.explored, 6),
            decision_ms=DecisionTime(
                median=round(float(np.median(times)), PLACES), p95=round(float(np.quantile(times, 0.95)), PLACES)
            ),
            corners=self.corners,
            reason=self.reason,
            unseen_m2=round(self.unseen, PLACES),
        )


class Place(NamedTuple):
    """How far an episode has come.

    Attributes:
        x: pixels of the image.
        y: pixels of the image.
        distance: travelled metres.
        explored: share of the reachable free area that was seen.
    """

    x: float
    y: float
    distance: float
    explored: float

    @classmethod
    def of(cls, environment: Environment) -> Place:
        """Return where an environment's robot stands."""
        x, y = _rounded(environment.world, environment.pose.position)
        return cls(x, y, environment.distance, environment.coverage.explored)


Tell = Callable[[str, Place | None], None]


def crashed(places: Sequence[Place], reason: str, kind: type[Outcome] = Outcome) -> Outcome:
    """Return the outcome, of some kind, of an episode that did not end by itself, with what it had done so far."""
    last = places[-1] if places else Place(0.0, 0.0, 0.0, 0.0)
    waypoints = [(place.x, place.y) for place in places]
    return kind(waypoints, last.distance, max(len(places) - 1, 0), False, last.explored, reason, [], crashed=True)


def tell_nobody(event: str, place: Place | None) -> None:
    """Take an event that nobody watches."""
    del event, place


def run_episode(
    environment: Environment,
    planner: Decider,
    world: GridMap,
    *,
    seed: int,
    time_limit: float,
    tell: Tell = tell_nobody,
) -> Outcome:
    """Run one episode.

    Args:
        environment: simulator, mapping and task.
        planner: who decides.
        world: where.
        seed: of simulator and planner.
        time_limit: seconds of processor time for one decision; a slower one ends the episode as a failure.
        tell: called with ``("start", place)``, then for each decision with ``("decide", None)`` before it,
            ``("drive", None)`` when it is taken, ``("moved", place)`` when it is carried out, so that a watcher knows
            how far an episode had come when its process ends.

    Raises:
        HDError: the world does not suit, or the planner broke the rules of the protocol.
    """
    environment.reset(world, seed, on_lattice=False)
    places = [Place.of(environment)]
    tell("start", places[-1])
    goal = environment.goal
    planner.reset(goal.task.asked_of(planner.name, planner.tasks), goal.target, seed)
    times: list[float] = []
    reason = ""
    while environment.end is End.NONE:
        tell("decide", None)
        # Processor time, so that another load of the machine does not decide what an episode is.
        began = time.process_time()
        plan = planner.plan(environment.mapper, environment.pose)
        worked = time.process_time() - began
        times.append(1e3 * (worked + environment.mapping_seconds))
        if worked > time_limit:
            reason = f"a decision took {worked:.1f} s, the limit is {time_limit:g} s"
            break
        if plan.status is not Status.GOING or plan.waypoint is None:
            reason = f"the planner says {plan.status.value}: {plan.reason}"
            break
        # Only deciding is limited: driving under physics takes what it takes.
        tell("drive", None)
        environment.step_to(plan.waypoint, plan.via)
        places.append(Place.of(environment))
        tell("moved", places[-1])
    notes = {name: count for name in COUNTS if (count := getattr(planner, name, None)) is not None}
    unseen = environment.coverage.unseen_area if not goal.task.needs_target and not environment.success else 0.0
    return Outcome(
        waypoints=[_rounded(world, position) for position in environment.positions],
        distance=environment.distance,
        steps=environment.steps,
        success=environment.success,
        explored=environment.coverage.explored,
        reason=(environment.reason or reason) + (_left(environment.coverage) if unseen else ""),
        decision_ms=times,
        notes=notes,
        corners=list(environment.corners),
        unseen=unseen,
    )


def _rounded(world: GridMap, position: Position) -> Position:
    """Return a position in pixels of the image, as results files have them."""
    x, y = to_pixels(world, position)
    return round(x, PLACES), round(y, PLACES)


def _left(coverage: Coverage) -> str:
    """Say what an exploration has not seen of what can be reached."""
    largest = coverage.largest_unseen()
    words = f"; {coverage.unseen_area:.1f} m2 of reachable space are unseen"
    if largest is not None:
        area, (x, y) = largest
        words += f", {area:.1f} m2 of it around ({x:.1f}, {y:.1f}) m"
    return words
