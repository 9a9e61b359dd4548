"""What navigation planners in continuous space share: the part of a path that may be driven now, and how it ends."""

from __future__ import annotations

from abc import abstractmethod
from math import hypot
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from common.jit import njit
from common.mapping.mapper import Mapper
from common.mapping.sight import FREE, Box
from common.planners.base import Plan, Position, Status
from common.planners.navigation import NavigationPlanner, unreachable
from common.planners.optimistic import MARGIN, OptimisticGrid

# A leg that is shorter than this, in spacings, and does not end where the path bends, is not worth a decision.
SHORTEST_LEG: Final = 0.125
# Paths that one decision plans before it gives up: each one after the first knows one more doubtful cell.
MAX_PATHS: Final = 12
# A robot that is farther from its last waypoint than this, in spacings, was called off on the way and has not arrived.
LARGEST_STOP: Final = 0.15
# Bends that are so many times as near as the robot stops before its waypoints are passed over.
STOP_MARGIN: Final = 1.25


@njit(cache=True, nogil=True)
def connected(possible: NDArray[np.int8], start: tuple[int, int], goal: tuple[int, int]) -> bool:
    """Whether cells (row, column) that are free connect two cells by their sides."""
    rows, columns = possible.shape
    if possible[start] != FREE or possible[goal] != FREE:
        return False
    cells = possible.reshape(-1)
    first, last = start[0] * columns + start[1], goal[0] * columns + goal[1]
    seen = np.zeros(rows * columns, dtype=np.bool_)
    stack = np.empty(rows * columns, dtype=np.int32)
    stack[0] = first
    seen[first] = True
    size = 1
    while size:
        size -= 1
        here = stack[size]
        if here == last:
            return True
        column = here % columns
        for step in (1, -1, columns, -columns):
            there = here + step
            if (step == 1 and column == columns - 1) or (step == -1 and column == 0):
                continue
            if 0 <= there < rows * columns and not seen[there] and cells[there] == FREE:
                seen[there] = True
                stack[size] = there
                size += 1
    return False


def along(start: Position, goal: Position, metres: float) -> Position:
    """Return the place so many metres from a start on the line to a goal, which lies elsewhere."""
    part = metres / hypot(goal[0] - start[0], goal[1] - start[1])
    return start[0] + part * (goal[0] - start[0]), start[1] + part * (goal[1] - start[1])


class FreeSpacePlanner(NavigationPlanner):
    """A navigation planner whose path may bend anywhere: subclasses plan it, unknown space taken as free.

    The waypoint is the farthest bend of the path that is in sight through known free space and near enough, or the
    last place before the first leg gets too long or leaves known free space. A leg that hardly begins meets a cell
    which the scan from right here could not resolve: it counts as an obstacle from then on, and the path is planned
    again.

    A robot that stops a little before its waypoints does not move for a nearer one. How far before is seen from where
    it stands after each leg; from a bend nearer than that the robot is sent on to the next leg, or past the bend.
    """

    grid: OptimisticGrid
    _stop: float

    def begin(self, target: Position, seed: int) -> None:
        """Forget everything."""
        del target, seed
        self.grid = OptimisticGrid(MARGIN * self.config.viewpoint_spacing)
        self._stop = 0.0

    def decide(self, mapper: Mapper, pose: Pose, target: Position) -> Plan:
        """Plan a path and return as much of it as may be driven now."""
        if not mapper.segment_free(pose.position, pose.position):
            return Plan(Status.STUCK, reason="the robot touches a cell that is not known to be free")
        if self._asked is not None:
            before = pose.distance_to(self._asked[1])
            if before <= LARGEST_STOP * self.config.viewpoint_spacing:
                self._stop = max(self._stop, before)
        for _ in range(MAX_PATHS):
            changed = self.grid.update(mapper.belief, pose.position, target)
            if not self.grid.possibly_free(target, target) or not connected(
                self.grid.possible, self.grid.cell(pose.position), self.grid.cell(target)
            ):
                return Plan(Status.UNREACHABLE, reason=unreachable(mapper, target))
            path = self.route(pose, target, changed)
            if path is None:
                return self.no_route(mapper, target)
            waypoint = self._reach(mapper, pose, path)
            if waypoint is not None:
                left = path[path.index(waypoint) + 1 :] if waypoint in path else path
                return Plan(Status.GOING, waypoint=waypoint, beacon=target, path=left)
        return Plan(Status.STUCK, reason=f"none of {MAX_PATHS} paths begins in space that is known to be free")

    def give_up(self, waypoint: Position) -> None:
        """Take the place for an obstacle for the rest of the episode."""
        self.grid.doubt(waypoint, always=True)

    @abstractmethod
    def route(self, pose: Pose, target: Position, changed: Box | None) -> list[Position] | None:
        """Plan a path through what `grid.possible` says is free.

        Args:
            pose: where the robot stands.
            target: metres.
            changed: box of the grid's cells that changed since the last call, None when there are none.

        Returns:
            The bends of the path, metres, without the robot's place, the target last; None when none was found.
        """

    @abstractmethod
    def no_route(self, mapper: Mapper, target: Position) -> Plan:
        """Say what it means that `route` found nothing although free and unknown cells lead to the target."""

    def _reach(self, mapper: Mapper, pose: Pose, path: list[Position]) -> Position | None:
        """Return how far along a path the robot may drive in one straight leg, or None when that is nowhere."""
        here = pose.position
        seen = 0
        for place in path:
            if pose.distance_to(place) > self._longest or not mapper.segment_free(here, place):
                break
            seen += 1
        if seen:
            bend = path[seen - 1]
            near = pose.distance_to(bend) <= STOP_MARGIN * self._stop
            return self._pass(mapper, pose, bend, path[seen]) if near and seen < len(path) else bend
        # The first leg is too long, or not known to be free all the way.
        low, high = self._sight(mapper, here, path[0])
        if low == high or low >= max(SHORTEST_LEG * self.config.viewpoint_spacing, STOP_MARGIN * self._stop):
            return along(here, path[0], low)
        self._doubt_around(along(here, path[0], high))
        return None

    def _pass(self, mapper: Mapper, pose: Pose, bend: Position, after: Position) -> Position | None:
        """Return where to send a robot that stops before a bend which it is near to, or None when that is nowhere.

        Args:
            mapper: what the robot knows.
            pose: where the robot stands.
            bend: in sight, metres.
            after: the next bend, which is not.
        """
        here, near = pose.position, STOP_MARGIN * self._stop
        low, high = self._sight(mapper, bend, after)
        step = 0.5 * self.config.resolution
        for metres in np.arange(low, 0.0, -step).tolist():
            place = along(bend, after, metres)
            if near < pose.distance_to(place) <= self._longest and mapper.segment_free(here, place):
                return place
        if low < high and low <= near:
            # The next leg hardly begins, and will not be known better from the bend than from right before it.
            self._doubt_around(along(bend, after, high))
            return None
        # The next leg is hidden behind a corner: a waypoint behind the bend brings the robot to the bend.
        beyond = along(here, bend, pose.distance_to(bend) + self._stop) if here != bend else bend
        return beyond if mapper.segment_free(here, beyond) else bend

    def _sight(self, mapper: Mapper, start: Position, goal: Position) -> tuple[float, float]:
        """Return how far a segment is known to be free, and where it no longer is, metres from its start.

        Both are its length, or that of the longest leg, when it is free so far.
        """
        low, high = 0.0, min(hypot(goal[0] - start[0], goal[1] - start[1]), self._longest)
        if mapper.segment_free(start, along(start, goal, high)):
            return high, high
        while high - low > 0.05 * self.config.resolution:
            middle = 0.5 * (low + high)
            if mapper.segment_free(start, along(start, goal, middle)):
                low = middle
            else:
                high = middle
        return low, high

    def _doubt_around(self, position: Position) -> None:
        """Doubt the cells at a position that are not known to be free; it may lie on the border of several."""
        step = 0.06 * self.config.resolution
        for dx in (-step, step):
            for dy in (-step, step):
                place = (position[0] + dx, position[1] + dy)
                if self.grid.known[self.grid.cell(place)] != FREE:
                    self.grid.doubt(place)
