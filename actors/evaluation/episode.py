"""One episode of a planner in a world, in the nominal protocol."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

from actors.environment import Environment
from actors.evaluation.outcome import Outcome, Place, in_pixels
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


Tell = Callable[[str, Place | None], None]


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
        environment.step_to(plan.waypoint, plan.via, plan.beacon)
        places.append(Place.of(environment))
        tell("moved", places[-1])
    notes = {name: count for name in COUNTS if (count := getattr(planner, name, None)) is not None}
    unseen = environment.coverage.unseen_area if not goal.task.needs_target and not environment.success else 0.0
    return Outcome(
        waypoints=[in_pixels(world, position) for position in environment.positions],
        distance=environment.distance,
        steps=environment.steps,
        success=environment.success,
        explored=environment.coverage.explored,
        reason=(environment.reason or reason) + (_left(environment.coverage) if unseen else ""),
        decision_ms=times,
        notes=notes,
        corners=list(environment.corners),
        unseen=unseen,
        collisions=environment.collisions,
    )


def _left(coverage: Coverage) -> str:
    """Say what an exploration has not seen of what can be reached."""
    largest = coverage.largest_unseen()
    words = f"; {coverage.unseen_area:.1f} m2 of reachable space are unseen"
    if largest is not None:
        area, (x, y) = largest
        words += f", {area:.1f} m2 of it around ({x:.1f}, {y:.1f}) m"
    return words
