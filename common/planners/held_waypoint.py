"""A waypoint that is several edges away, kept until the robot is there or it makes no sense any more."""

from __future__ import annotations

from math import inf
from typing import Final

import numpy as np

from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Position

# Plans in a row from one place before the waypoint is given up: something keeps the robot from going.
_MAX_ATTEMPTS: Final = 3


class HeldWaypoint:
    """What a planner has decided to drive to, while the robot is on its way over several edges."""

    def __init__(self, spacing: float) -> None:
        """Hold nothing; `spacing` of the viewpoints in metres."""
        self._spacing = spacing
        self._position: Position | None = None

    def hold(self, mapper: Mapper, node: int) -> None:
        """Hold a node of the last update."""
        self._position = mapper.position(node)
        self._target_known = mapper.target_known
        self._distance = inf
        self._here: Position | None = None
        self._attempts = 0

    def node(self, mapper: Mapper, pose: Pose) -> int | None:
        """Return the node to go on to, None when a new decision is due.

        It is due when nothing is held, when the robot is there, when the viewpoint is gone or its way has become longer
        by two spacings (a wall came into view), when the target has become known, or when the robot does not move.
        """
        if self._position is None:
            return None
        node = self._find(mapper)
        if node is None or node == mapper.robot or mapper.target_known != self._target_known:
            self._position = None
            return None
        distance = float(mapper.distances(mapper.robot)[node])
        self._attempts = self._attempts + 1 if self._here == pose.position else 1
        self._here = pose.position
        if distance > self._distance + 2.0 * self._spacing or distance == inf or self._attempts > _MAX_ATTEMPTS:
            self._position = None
            return None
        self._distance = min(self._distance, distance)
        return node

    def _find(self, mapper: Mapper) -> int | None:
        positions = mapper.viewpoints
        if self._position == mapper.target:
            return len(positions)
        beside = np.hypot(*(positions - np.array(self._position)).T)
        node = int(np.argmin(beside))
        return node if beside[node] < 0.25 * self._spacing else None
