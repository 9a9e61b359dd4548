"""A waypoint that is several edges away, kept until the robot is there or it makes no sense any more."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Final

import numpy as np

from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Position

# Plans in a row from one place before the waypoint is given up: something keeps the robot from going.
_MAX_ATTEMPTS: Final = 3


@dataclass
class _Held:
    position: Position
    useful: bool
    target_known: bool
    distance: float = inf
    place: Position | None = None
    attempts: int = 0


class HeldWaypoint:
    """What a planner has decided to drive to, while the robot is on its way over several edges."""

    def __init__(self, spacing: float) -> None:
        """Hold nothing; `spacing` of the viewpoints in metres."""
        self._spacing = spacing
        self._held: _Held | None = None

    def hold(self, mapper: Mapper, node: int) -> None:
        """Hold a node of the last update."""
        self._held = _Held(mapper.position(node), _observes(mapper, node), mapper.target_known)

    def node(self, mapper: Mapper, pose: Pose) -> int | None:
        """Return the node to go on to, None when a new decision is due.

        It is due when nothing is held, when the robot is there, when the viewpoint is gone or its way has become longer
        by two spacings (a wall came into view), when the frontiers that it observed have all been seen, when the target
        has become known, or when the robot does not move.
        """
        node = None if self._held is None else self._find(mapper, self._held)
        if self._held is None or node is None or not self._stands(mapper, pose, self._held, node):
            self._held = None
            return None
        return node

    def _stands(self, mapper: Mapper, pose: Pose, held: _Held, node: int) -> bool:
        """Whether the decision for a node still makes sense."""
        if node == mapper.robot or mapper.target_known != held.target_known:
            return False
        if held.useful and not _observes(mapper, node):
            return False
        distance = float(mapper.distances(mapper.robot)[node])
        longer = distance == inf or distance > held.distance + 2.0 * self._spacing
        held.distance = min(held.distance, distance)
        held.attempts = held.attempts + 1 if held.place == pose.position else 1
        held.place = pose.position
        return not longer and held.attempts <= _MAX_ATTEMPTS

    def _find(self, mapper: Mapper, held: _Held) -> int | None:
        positions = mapper.viewpoints
        if held.position == mapper.target:
            return len(positions)
        beside = np.hypot(*(positions - np.array(held.position)).T)
        node = int(np.argmin(beside))
        return node if beside[node] < 0.25 * self._spacing else None


def _observes(mapper: Mapper, node: int) -> bool:
    """Whether a node observes frontiers; the target does not."""
    utility = mapper.observe().utility
    return node < len(utility) and bool(utility[node])
