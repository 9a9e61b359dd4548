"""How an episode of an evaluation went, and how far it has come."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypedDict

import numpy as np

from actors.environment import Environment
from actors.evaluation.pixels import to_pixels
from actors.evaluation.results import PLACES, DecisionTime, EpisodeResult
from actors.maps.grid_map import GridMap
from common.planners.base import Position

CurvePoint = tuple[float, float, float, float]
"""(seconds, metres, cubic metres, explored share)."""


class TrackPoint(NamedTuple):
    """The robot at one scan.

    Attributes:
        time: simulated seconds since the start.
        x: metres.
        y: metres.
        yaw: radians.
    """

    time: float
    x: float
    y: float
    yaw: float


class Leg(TypedDict):
    """The way to one target of a tour, as plain values.

    Attributes:
        target: (x, y) in metres, map frame.
        distance_m: travelled metres.
        time_s: simulated seconds of driving.
        steps: decisions.
        collisions: contacts with walls.
        success: the robot arrived.
        reason: why the leg ended.
    """

    target: Position
    distance_m: float
    time_s: float
    steps: int
    collisions: int
    success: bool
    reason: str


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
        collisions: contacts with walls.
        time: simulated seconds of driving; this and what follows only of an evaluation at a large scale.
        volume: explored volume, cubic metres.
        track: (seconds, x, y, yaw) at every scan, metres and radians in the map frame.
        curve: (seconds, metres, cubic metres, explored share) at the start and after every decision.
        legs: of a tour, one for each target; the other figures are those of all of them together.
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
    collisions: int = 0
    time: float = 0.0
    volume: float = 0.0
    track: list[TrackPoint] = field(default_factory=list)
    curve: list[CurvePoint] = field(default_factory=list)
    legs: list[Leg] = field(default_factory=list)

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
        x, y = in_pixels(environment.world, environment.pose.position)
        return cls(x, y, environment.distance, environment.coverage.explored)


def crashed(places: Sequence[Place], reason: str) -> Outcome:
    """Return the outcome of an episode that did not end by itself, with what it had done so far."""
    last = places[-1] if places else Place(0.0, 0.0, 0.0, 0.0)
    waypoints = [(place.x, place.y) for place in places]
    return Outcome(waypoints, last.distance, max(len(places) - 1, 0), False, last.explored, reason, [], crashed=True)


def in_pixels(world: GridMap, position: Position) -> Position:
    """Return a position in pixels of the image, as results files have them."""
    x, y = to_pixels(world, position)
    return round(x, PLACES), round(y, PLACES)
