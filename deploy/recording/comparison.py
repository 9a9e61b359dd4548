"""Compares the decisions of a recording with those that were made anew."""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot

from common.planners.base import Position

_SAME = 0.01


@dataclass(frozen=True, slots=True)
class Decision:
    """Where the robot was sent.

    Attributes:
        time: seconds since 1970, by the arrival of messages.
        waypoint: (x, y) in the map frame, metres; None to stand.
        beacon: the area behind it, where there is one.
        pose: of the robot, where it is known.
    """

    time: float
    waypoint: Position | None
    beacon: Position | None = None
    pose: Position | None = None


@dataclass(frozen=True, slots=True)
class Difference:
    """One recorded decision, and how far the new one lies from it.

    Attributes:
        time: seconds since the recording began.
        recorded: waypoint then.
        replayed: waypoint now; None where nothing was decided.
        distance: between the two, metres; infinite where nothing was decided.
        pose: of the robot.
    """

    time: float
    recorded: Position
    replayed: Position | None
    distance: float
    pose: Position | None


@dataclass(frozen=True, slots=True)
class Comparison:
    """How well the decisions agree.

    Attributes:
        differences: one for every recorded decision.
        tolerance: waypoints so near count as the same, metres.
    """

    differences: tuple[Difference, ...]
    tolerance: float

    @property
    def agreement(self) -> float:
        """Share of the recorded decisions that were made anew, from 0 to 1; 1 where there are none."""
        if not self.differences:
            return 1.0
        return sum(one.distance <= self.tolerance for one in self.differences) / len(self.differences)

    @property
    def first(self) -> Difference | None:
        """The first decision that is another one."""
        return next((one for one in self.differences if one.distance > self.tolerance), None)

    def distances(self) -> list[float]:
        """Return the distances between the waypoints in ascending order, metres; without those never decided."""
        return sorted(one.distance for one in self.differences if one.replayed is not None)


def changes(decisions: Sequence[Decision]) -> list[Decision]:
    """Return the decisions that send the robot elsewhere than the one before."""
    kept: list[Decision] = []
    last: Position | None = None
    for decision in decisions:
        if decision.waypoint is not None and (last is None or _gap(decision.waypoint, last) > _SAME):
            kept.append(decision)
        last = decision.waypoint
    return kept


def compare(
    recorded: Sequence[Decision], replayed: Sequence[Decision], begin: float, tolerance: float, window: float = 0.6
) -> Comparison:
    """Compare every recorded change of the waypoint with what was decided anew at that time.

    A replay decides by the same messages but not at the very same moments, so the nearest waypoint of those in force
    within `window` counts.

    Args:
        recorded: in order of time.
        replayed: in order of time; each is in force until the next.
        begin: of the recording, seconds since 1970.
        tolerance: metres.
        window: seconds before and after.
    """
    times = [decision.time for decision in replayed]
    found = []
    for decision in changes(recorded):
        assert decision.waypoint is not None
        low = max(bisect.bisect_right(times, decision.time - window) - 1, 0)
        high = bisect.bisect_right(times, decision.time + window)
        best: Position | None = None
        distance = float("inf")
        for candidate in replayed[low:high]:
            if candidate.waypoint is not None and _gap(candidate.waypoint, decision.waypoint) < distance:
                best, distance = candidate.waypoint, _gap(candidate.waypoint, decision.waypoint)
        found.append(Difference(decision.time - begin, decision.waypoint, best, distance, decision.pose))
    return Comparison(tuple(found), tolerance)


def _gap(one: Position, other: Position) -> float:
    return hypot(one[0] - other[0], one[1] - other[1])
