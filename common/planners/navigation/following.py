"""Following a path through what might be free: the part of it that may be driven now."""

from __future__ import annotations

from math import ceil, hypot
from typing import Final

import numpy as np

from common.config import MappingConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.raycast import SUBCELLS
from common.mapping.sight import FREE
from common.mapping.viewpoints import LONGEST_EDGE
from common.planners.base import Position
from common.planners.navigation.optimistic import OptimisticBelief

# A leg that is shorter than this, in spacings, and does not end where the path bends, is not worth a decision.
SHORTEST_LEG: Final = 0.125
# A robot with a size sees around a corner little by little: for it legs of so many cells are worth a decision.
SHORTEST_CELLS: Final = 2.0
# A robot that is farther from its last waypoint than this, in spacings, was called off on the way and has not arrived.
LARGEST_STOP: Final = 0.15
# Bends that are so many times as near as the robot stops before its waypoints are passed over.
STOP_MARGIN: Final = 1.25
# Places are looked at a little to every side, cells: they may lie on the border of several cells.
_BESIDE: Final = 0.06


def along(start: Position, goal: Position, metres: float) -> Position:
    """Return the place so many metres from a start on the line to a goal, which lies elsewhere."""
    part = metres / hypot(goal[0] - start[0], goal[1] - start[1])
    return start[0] + part * (goal[0] - start[0]), start[1] + part * (goal[1] - start[1])


class PathFollower:
    """Says how far along a path the robot may drive in one straight leg, and doubts what keeps it from driving further.

    The waypoint is the farthest bend of the path that is in sight through known clear space and near enough, or the
    last place before the first leg gets too long or leaves known clear space. A leg that hardly begins meets a cell
    which the scan from right here could not resolve: it counts as an obstacle from then on.

    A robot that stops a little before its waypoints does not move for a nearer one. How far before is seen from where
    it stands after each leg; from a bend nearer than that the robot is sent on to the next leg, or past the bend.
    """

    def __init__(self, config: MappingConfig, world: OptimisticBelief) -> None:
        """Set up for a mapping, and for the world whose cells are to be doubted."""
        self._config = config
        self._world = world
        self._longest = LONGEST_EDGE * config.viewpoint_spacing
        self._shortest = SHORTEST_LEG * config.viewpoint_spacing
        if config.robot_radius > 0.0:
            self._shortest = min(self._shortest, SHORTEST_CELLS * config.resolution)
        self._stop = 0.0

    @property
    def near(self) -> float:
        """Places nearer than this count as reached, metres."""
        return STOP_MARGIN * self._stop

    def note_stop(self, metres: float) -> None:
        """Note how far from its last waypoint the robot has stopped."""
        if metres <= LARGEST_STOP * self._config.viewpoint_spacing:
            self._stop = max(self._stop, metres)

    def reach(self, mapper: Mapper, pose: Pose, path: list[Position]) -> Position | None:
        """Return how far along a path the robot may drive in one straight leg, or None when that is nowhere."""
        here = pose.position
        seen = 0
        for place in path:
            if pose.distance_to(place) > self._longest or not mapper.segment_free(here, place):
                break
            seen += 1
        if seen:
            bend = path[seen - 1]
            near = pose.distance_to(bend) <= self.near
            return self._pass(mapper, pose, bend, path[seen]) if near and seen < len(path) else bend
        # The first leg is too long, or not known to be clear all the way.
        low, high = self._sight(mapper, here, path[0])
        if low == high or low >= max(self._shortest, self.near):
            return along(here, path[0], low)
        self._doubt_around(mapper, along(here, path[0], high))
        return None

    def _pass(self, mapper: Mapper, pose: Pose, bend: Position, after: Position) -> Position | None:
        """Return where to send a robot that stops before a bend which it is near to, or None when that is nowhere.

        Args:
            mapper: what the robot knows.
            pose: where the robot stands.
            bend: in sight, metres.
            after: the next bend, which is not.
        """
        here = pose.position
        low, high = self._sight(mapper, bend, after)
        step = 0.5 * self._config.resolution
        for metres in np.arange(low, 0.0, -step).tolist():
            place = along(bend, after, metres)
            if self.near < pose.distance_to(place) <= self._longest and mapper.segment_free(here, place):
                return place
        if low < high and low <= self.near:
            # The next leg hardly begins, and will not be known better from the bend than from right before it.
            self._doubt_around(mapper, along(bend, after, high))
            return None
        # The next leg is hidden behind a corner: a waypoint behind the bend brings the robot to the bend.
        beyond = along(here, bend, pose.distance_to(bend) + self._stop) if here != bend else bend
        return beyond if mapper.segment_free(here, beyond) else bend

    def _sight(self, mapper: Mapper, start: Position, goal: Position) -> tuple[float, float]:
        """Return how far a segment is known to be clear, and where it no longer is, metres from its start.

        Both are its length, or that of the longest leg, when it is clear so far.
        """
        low, high = 0.0, min(hypot(goal[0] - start[0], goal[1] - start[1]), self._longest)
        if mapper.segment_free(start, along(start, goal, high)):
            return high, high
        while high - low > 0.05 * self._config.resolution:
            middle = 0.5 * (low + high)
            if mapper.segment_free(start, along(start, goal, middle)):
                low = middle
            else:
                high = middle
        return low, high

    def _doubt_around(self, mapper: Mapper, position: Position) -> None:
        """Doubt the cells within the robot's radius of a position that are not known to be free."""
        step = self._config.resolution
        x, y = (value / SUBCELLS for value in mapper.belief.subcells(position))
        radius = self._config.robot_radius / step + _BESIDE
        reach = ceil(radius)
        for row in range(int(y) - reach, int(y) + reach + 1):
            for column in range(int(x) - reach, int(x) + reach + 1):
                gap = hypot(max(column - x, 0.0, x - column - 1.0), max(row - y, 0.0, y - row - 1.0))
                middle = (position[0] + (column + 0.5 - x) * step, position[1] + (row + 0.5 - y) * step)
                if gap <= radius and mapper.belief.at(middle) != FREE:
                    self._world.doubt(middle)
