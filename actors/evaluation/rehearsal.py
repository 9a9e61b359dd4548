"""Routes driven in the grid simulator before they are driven in earnest."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from actors.evaluation.retrace import Moment, follow
from actors.maps.grid_map import GridMap
from common.config import MappingConfig, SimulatorConfig, TaskConfig
from common.mapping.mapper import Mapper
from common.planners.base import Planner, Position, Status
from common.tasks import EXPLORATION

log = logging.getLogger(__name__)

Leg = list[Position]
"""What one decision drives: corners of the way and its end, metres."""


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """What came of driving a route in the grid simulator.

    Attributes:
        legs: what was driven, decision by decision; the task was complete at the end of it, or the route ended.
        complete: the task was complete.
        length: metres.
        unseen: cells of the true map that are still unseen.
    """

    legs: list[Leg]
    complete: bool
    length: float
    unseen: NDArray[np.int64]


class Rehearsals:
    """Drives explorations in the grid simulator, with the scans that an episode of the same seed has."""

    def __init__(self, mapping: MappingConfig, task: TaskConfig, simulator: SimulatorConfig) -> None:
        """Set up.

        Args:
            mapping: lattice and sensor.
            task: when it is complete, and after how many decisions a planner's route ends.
            simulator: beams and noise of the sensor.
        """
        self._mapping = mapping
        self._task = task
        self._simulator = simulator.model_copy(update={"name": "grid"})

    def of_route(self, world: GridMap, legs: list[Leg], seed: int) -> Rehearsal:
        """Drive a route."""
        ahead = list(legs)

        def decide(moment: Moment) -> Leg:
            if not ahead:
                return []
            part, rest = known_part(moment.mapper, moment.pose.position, ahead.pop(0))
            if rest:
                ahead.insert(0, rest)
            return part

        return self._drive(world, decide, seed, None)

    def of_planner(self, world: GridMap, planner: Planner, seed: int) -> Rehearsal:
        """Drive where a planner goes that does not know the map."""
        planner.reset(EXPLORATION.name, None, seed)

        def decide(moment: Moment) -> Leg:
            plan = planner.plan(moment.mapper, moment.pose)
            return [*plan.via, plan.waypoint] if plan.status is Status.GOING and plan.waypoint is not None else []

        return self._drive(world, decide, seed, self._task.max_steps)

    def _drive(self, world: GridMap, decide: Callable[[Moment], Leg], seed: int, most: int | None) -> Rehearsal:
        """Drive legs, at most so many, until there is none or the task is complete."""
        driven: list[Leg] = []
        moment: Moment

        def places() -> Iterator[Position]:
            yield world.start
            while most is None or len(driven) < most:
                leg = decide(moment)
                if not leg:
                    return
                driven.append([])
                for place in leg:
                    driven[-1].append(place)
                    yield place

        for moment in follow(world, places(), self._mapping, self._simulator, seed=seed):
            unseen = moment.coverage.unseen_cells
            if not (moment.known and moment.clear):
                log.debug("map %r: the way to %s is not known to be free", world.name, driven[-1][-1])
                return Rehearsal(driven[:-1], False, moment.distance, unseen)
            if moment.coverage.unseen_area <= self._task.unseen_area + 1e-9:
                return Rehearsal(driven, True, moment.distance, unseen)
        return Rehearsal(driven, False, moment.distance, unseen)


def known_part(mapper: Mapper, here: Position, leg: Leg) -> tuple[Leg, Leg]:
    """Part a leg into what the robot knows to be free, one decision, and what is left of it.

    What lies behind a corner is seldom known before the robot is there. Where not even the way to the first corner is
    known, the robot drives as far as it knows it to be free and looks again.

    Args:
        mapper: updated where the robot is.
        here: where the robot is, metres.
        leg: corners and end of a way that truly is free.

    Returns:
        Where to drive now, at least one position, and what is left, both in metres.
    """
    known = 0
    for a, b in pairwise([here, *leg]):
        if not mapper.segment_free(a, b):
            break
        known += 1
    if known:
        return leg[:known], leg[known:]
    x, y = leg[0][0] - here[0], leg[0][1] - here[1]
    cells = int(np.hypot(x, y) / mapper.belief.resolution)
    free, blocked = 0, cells + 1
    while blocked - free > 1:
        middle = (free + blocked) // 2
        share = middle / (cells + 1)
        if mapper.segment_free(here, (here[0] + share * x, here[1] + share * y)):
            free = middle
        else:
            blocked = middle
    if not free:
        return leg[:1], leg[1:]
    share = free / (cells + 1)
    return [(here[0] + share * x, here[1] + share * y)], leg
