"""Frontiers at the edge of the space that the robot can reach: what an exploration must not end with unsaid.

A viewpoint that sees a frontier may not see past the corner behind which it lies; then going there, to the edge itself,
is what shows more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, pi
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.sight import FREE
from common.planners.base import Plan, Position, Status
from common.system.copies import copy_values
from common.system.jit import njit
from deploy.bridge.cell_way import centre_of, nearest_way

# Cells beyond the robot's radius within which a frontier borders on where the robot can get to.
_BORDER: Final = 2
# A robot beside the space where it fits gets back to it through free cells within this, metres.
_BESIDE: Final = 1.0
_REASON: Final = "to the edge of a frontier that no viewpoint resolves"


@dataclass(frozen=True, slots=True)
class Unseen:
    """Frontiers that border on space that the robot can reach.

    Attributes:
        length: of all of them, metres.
        places: how many there are.
        largest: length of the longest one, metres.
        position: of its middle cell, (x, y) in the map frame, metres.
    """

    length: float
    places: int
    largest: float
    position: Position

    def __str__(self) -> str:
        """Tell it in words."""
        x, y = self.position
        many = f" at {self.places} places, the longest ({self.largest:.1f} m)" if self.places > 1 else ""
        where = f"around ({x:.1f}, {y:.1f}) m"
        return f"{self.length:.1f} m of frontier at the edge of what the robot can reach are left{many} {where}"


def find_unseen(mapper: Mapper, radius: float) -> Unseen | None:
    """Find the frontiers that border on space that the robot can reach.

    A frontier that is shorter than the robot is wide is left out: no space that it can reach begins there.

    Args:
        mapper: of this moment.
        radius: of the robot, metres.

    Returns:
        None when there are none.
    """
    return unseen_from(mapper, radius, mapper.reachable_cells())


def unseen_from(mapper: Mapper, radius: float, space: NDArray[np.bool_], margin: float = 0.0) -> Unseen | None:
    """Find the frontiers that border on some space, bool, shape of the belief's padded grid; see `find_unseen`.

    A margin, metres, is how much farther from the space they may be.
    """
    groups = _frontiers(mapper, radius, space, margin)
    if not groups:
        return None
    size = mapper.belief.resolution
    longest = max(groups, key=len)
    return Unseen(
        length=sum(map(len, groups)) * size,
        places=len(groups),
        largest=len(longest) * size,
        position=centre_of(mapper, int(longest[len(longest) // 2])),
    )


def confined(mapper: Mapper, pose: Pose, radius: float) -> bool:
    """Whether the robot cannot get out of where it stands, although free space leads on from there to a frontier.

    Its middle can get to less space than its body covers: by the map it is wedged in, between walls that leave it no
    room to go along them.

    Args:
        mapper: updated at the pose.
        pose: of the robot.
        radius: of the robot, metres.
    """
    belief = mapper.belief
    if np.count_nonzero(mapper.reachable_cells()) * belief.resolution**2 >= pi * radius**2:
        return False
    frontier = mapper.frontier_mask
    return bool(frontier.any()) and bool(nearest_way(mapper, pose.position, belief.padded == FREE, frontier))


def go_to_unseen(mapper: Mapper, pose: Pose, radius: float, skip: Callable[[Position], bool]) -> Plan | None:
    """Go to the nearest place at the edge of an unseen frontier; None where there is none left.

    Args:
        mapper: updated at the pose.
        pose: of the robot.
        radius: of the robot, metres.
        skip: whether a frontier cell at a place is not worth going to: looked at from near by, banned, or fenced off.
    """
    belief = mapper.belief
    cells = [
        cell
        for group in _frontiers(mapper, radius, mapper.reachable_cells())
        for cell in group.tolist()
        if not skip(centre_of(mapper, cell))
    ]
    if not cells:
        return None
    reachable = mapper.reachable_cells()
    near = _steps_from(
        belief.padded.reshape(-1), belief.padded.shape[1], np.array(cells, dtype=np.int64), _reach(mapper, radius)
    ).reshape(belief.padded.shape)
    passable = reachable | ((belief.padded == FREE) & _around(mapper, pose))
    way = nearest_way(mapper, pose.position, passable, reachable & (near >= 0))
    if not way:
        return None
    return Plan(Status.GOING, waypoint=way[-1], via=way[:-1], beacon=way[-1], reason=_REASON)


def _frontiers(mapper: Mapper, radius: float, space: NDArray[np.bool_], margin: float = 0.0) -> list[NDArray[np.int64]]:
    """Return the frontiers that border on some space: flat cells of the padded grid of each."""
    belief = mapper.belief
    width = belief.padded.shape[1]
    reach = _reach(mapper, radius + margin)
    steps = _steps_from(belief.padded.reshape(-1), width, np.flatnonzero(space.reshape(-1)), reach)
    cells, starts = _groups(width, mapper.frontier_mask.reshape(-1) & (steps >= 0))
    groups = [cells[a:b] for a, b in pairwise(starts.tolist())]
    return [group for group in groups if len(group) * belief.resolution >= 2.0 * radius]


def _reach(mapper: Mapper, radius: float) -> int:
    return ceil(radius / mapper.belief.resolution) + _BORDER


def _around(mapper: Mapper, pose: Pose) -> NDArray[np.bool_]:
    """Return the cells around the robot, bool, shape of the padded grid."""
    mask = np.zeros(mapper.belief.padded.shape, dtype=np.bool_)
    row, column = mapper.belief.cell(pose.position)
    span = ceil(_BESIDE / mapper.belief.resolution)
    mask[max(row + 1 - span, 0) : max(row + 2 + span, 0), max(column + 1 - span, 0) : max(column + 2 + span, 0)] = True
    return mask


@njit(cache=True, nogil=True)
def _steps_from(cells: NDArray[np.int8], width: int, sources: NDArray[np.int64], most: int) -> NDArray[np.int16]:
    """Return how many steps over free cells each cell is from the nearest source, -1 for more than ``most``."""
    steps = np.full(len(cells), -1, dtype=np.int16)
    queue = np.empty(len(cells), dtype=np.int64)
    copy_values(queue, sources)
    steps[sources] = 0
    head, tail = 0, len(sources)
    while head < tail:
        here = queue[head]
        head += 1
        if steps[here] == most:
            continue
        for there in (here - width, here - 1, here + 1, here + width):
            if steps[there] < 0 and cells[there] == FREE:
                steps[there] = steps[here] + 1
                queue[tail] = there
                tail += 1
    return steps


@njit(cache=True, nogil=True)
def _groups(width: int, frontier: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Group frontier cells that touch, corners included; ``frontier`` is used up.

    Returns:
        Flat cells, those of one group in the order of a flood, and the first entry of each group, then their number.
    """
    found = np.empty(len(frontier), dtype=np.int64)
    starts = [np.int64(0)]
    size = 0
    for cell in range(len(frontier)):
        if not frontier[cell]:
            continue
        at = size
        found[size] = cell
        size += 1
        frontier[cell] = False
        while at < size:
            here = found[at]
            at += 1
            for dy in (-width, 0, width):
                for dx in (-1, 0, 1):
                    there = here + dy + dx
                    if frontier[there]:
                        frontier[there] = False
                        found[size] = there
                        size += 1
        starts.append(np.int64(size))
    return found[:size].copy(), np.array(starts)
