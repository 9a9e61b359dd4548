"""A way over the cells of the belief, for where the lattice of viewpoints does not lead.

A doorway narrower than the distance between viewpoints can lie between two columns of the lattice. The graph ends
there, the free cells do not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from math import hypot
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from common.jit import njit
from common.mapping.mapper import Mapper
from common.mapping.sight import FREE, OCCUPIED, UNKNOWN
from common.planners.base import Plan, Position, Status
from common.mapping.viewpoints import LONGEST_EDGE

# A frontier cell counts with so many others around it, itself included; fewer are noise.
_CLUSTER: Final = 4
_CLUSTER_RADIUS: Final = 3
# A frontier that the robot came so near to, in viewpoint spacings, was looked at.
_LOOKED_AT: Final = 0.5
# Straight neighbours first, so that paths are straight where they can be.
_STEPS: Final = np.array([(1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)], dtype=np.int64)
_REASON: Final = "over free cells, because no viewpoint leads there"

Disc = tuple[Position, float]
"""A place, metres, and the radius around it, metres."""


@njit(cache=True, nogil=True)
def _nearest(
    cells: NDArray[np.int8], width: int, start: int, goals: NDArray[np.bool_], through_unknown: bool
) -> tuple[int, NDArray[np.int32]]:
    """Flood the padded grid from a cell until a goal cell is reached.

    Returns:
        Flat index of the goal, -1 when none is reached; and of the cell before each, int32, shape (cells,).
    """
    before = np.full(len(cells), -1, dtype=np.int32)
    queue = np.empty(len(cells), dtype=np.int32)
    queue[0] = start
    before[start] = start
    head, tail = 0, 1
    while head < tail:
        here = queue[head]
        head += 1
        if goals[here]:
            return here, before
        for k in range(8):
            dx, dy = _STEPS[k]
            there = here + dy * width + dx
            if before[there] >= 0 or not _passable(cells[there], through_unknown):
                continue
            if k >= 4 and not (
                _passable(cells[here + dx], through_unknown) and _passable(cells[here + dy * width], through_unknown)
            ):
                continue
            before[there] = here
            queue[tail] = there
            tail += 1
    return -1, before


@njit(cache=True, nogil=True, inline="always")
def _passable(cell: int, through_unknown: bool) -> bool:
    return cell == FREE or (through_unknown and cell == UNKNOWN)


def to_frontier(
    mapper: Mapper, pose: Pose, spacing: float, skip: Callable[[Position], bool], closed: Iterable[Disc] = ()
) -> Plan:
    """Go to the nearest frontier that free cells lead to.

    Args:
        mapper: updated at the pose.
        pose: of the robot.
        spacing: between viewpoints, metres.
        skip: whether a frontier is not worth going to: it was tried, is banned or fenced off.
        closed: discs that the way may not cross, but for those that the robot stands in.

    Returns:
        A plan; COMPLETE when no frontier is left that free cells lead to.
    """
    goals = np.zeros(mapper.belief.padded.shape, dtype=np.bool_)
    frontiers = mapper.frontiers
    rows, columns = _cells_of(mapper, frontiers)
    crowd = np.zeros(goals.shape, dtype=np.int32)
    crowd[rows, columns] = 1
    crowded = _box_sums(crowd)[rows, columns] >= _CLUSTER
    near = np.hypot(frontiers[:, 0] - pose.x, frontiers[:, 1] - pose.y) <= _LOOKED_AT * spacing
    for index in np.flatnonzero(crowded & ~near).tolist():
        goals[rows[index], columns[index]] = not skip((float(frontiers[index, 0]), float(frontiers[index, 1])))
    if not goals.any():
        return Plan(Status.COMPLETE, reason="no frontier is left that free cells lead to")
    return _follow(mapper, pose, goals, spacing, closed, through_unknown=False) or Plan(
        Status.COMPLETE, reason="free cells lead to no frontier that is left"
    )


def to_target(mapper: Mapper, pose: Pose, target: Position, spacing: float, closed: Iterable[Disc] = ()) -> Plan:
    """Go towards a target over free cells, unknown ones taken as free; ``closed`` as in `to_frontier`."""
    goals = np.zeros(mapper.belief.padded.shape, dtype=np.bool_)
    row, column = mapper.belief.cell(target)
    rows, columns = mapper.belief.shape
    # Of a target beyond the map the nearest cell of the map's rim takes the place.
    row, column = min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)
    goals[row + 1, column + 1] = True
    return _follow(mapper, pose, goals, spacing, closed, through_unknown=True) or Plan(
        Status.UNREACHABLE, reason="obstacles close every way to the target, unknown cells taken as free"
    )


def _follow(
    mapper: Mapper,
    pose: Pose,
    goals: NDArray[np.bool_],
    spacing: float,
    closed: Iterable[Disc],
    *,
    through_unknown: bool,
) -> Plan | None:
    """Plan along the cells to the nearest goal: as far as free cells go, in straight free legs."""
    padded = _without(mapper, pose, closed)
    width = padded.shape[1]
    row, column = mapper.belief.cell(pose.position)
    start = (row + 1) * width + column + 1
    if not (0 <= row < padded.shape[0] - 2 and 0 <= column < width - 2):
        return None
    goal, before = _nearest(padded.reshape(-1), width, start, goals.reshape(-1), through_unknown)
    if goal < 0:
        return None
    trail = [goal]
    while trail[-1] != start:
        trail.append(int(before[trail[-1]]))
    places = [_centre(mapper, index, width) for index in trail[::-1]]
    known = next((k for k, place in enumerate(places[1:], 1) if mapper.belief.at(place) != FREE), len(places))
    places = places[1:known]
    if not places:
        return None
    legs = _legs(mapper, pose.position, places, LONGEST_EDGE * spacing)
    if not legs:
        return None
    return Plan(Status.GOING, waypoint=legs[0], beacon=places[-1], path=legs[1:], reason=_REASON)


def _without(mapper: Mapper, pose: Pose, closed: Iterable[Disc]) -> NDArray[np.int8]:
    """Return the padded grid with discs closed, but for those that the robot stands in."""
    padded, size = mapper.belief.padded, mapper.belief.resolution
    discs = [(place, radius) for place, radius in closed if pose.distance_to(place) > radius]
    if not discs:
        return padded
    padded = padded.copy()
    rows, columns = np.ogrid[: padded.shape[0], : padded.shape[1]]
    x, y = mapper.belief.origin
    for place, radius in discs:
        apart = np.hypot(x + (columns - 0.5) * size - place[0], y + (rows - 0.5) * size - place[1])
        padded[apart <= radius] = OCCUPIED
    return padded


def _legs(mapper: Mapper, start: Position, places: list[Position], longest: float) -> list[Position]:
    """Pull a trail of cells straight: from each corner to the farthest place in a straight free line."""
    legs: list[Position] = []
    here, k = start, 0
    while k < len(places):
        # The next cell itself may not be in a free line from a robot in a corner: it is gone to all the same.
        farthest = k
        for j in range(k, len(places)):
            far = hypot(places[j][0] - here[0], places[j][1] - here[1]) > longest
            if far or not mapper.segment_free(here, places[j]):
                break
            farthest = j
        legs.append(places[farthest])
        here, k = places[farthest], farthest + 1
    return legs


def _cells_of(mapper: Mapper, positions: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows and columns in the padded grid."""
    offset = (positions - np.array(mapper.belief.origin)) / mapper.belief.resolution
    cells = np.floor(offset).astype(np.int64) + 1
    return cells[:, 1], cells[:, 0]


def _box_sums(values: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the sums over squares of 2 `_CLUSTER_RADIUS` + 1 cells."""
    n = _CLUSTER_RADIUS
    sums = np.pad(values, ((n + 1, n), (n + 1, n))).cumsum(0).cumsum(1)
    size = 2 * n + 1
    return (sums[size:, size:] - sums[:-size, size:] - sums[size:, :-size] + sums[:-size, :-size]).astype(np.int32)


def _centre(mapper: Mapper, index: int, width: int) -> Position:
    row, column = divmod(index, width)
    (x, y), size = mapper.belief.origin, mapper.belief.resolution
    return x + (column - 0.5) * size, y + (row - 0.5) * size
