"""Paths from cell to cell through space where the robot may fit: whether there is one, and a short one."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.mapping.clearance import passable
from common.mapping.raycast import SUBCELL_BITS, SUBCELLS
from common.mapping.sight import CLEAR, blocker
from common.system.copies import copy_values
from common.system.heap import pop, push
from common.system.jit import njit

_DIAGONAL: Final = 2.0**0.5


@njit(cache=True, nogil=True)
def connected(clear: NDArray[np.int8], start: int, goal: int) -> bool:
    """Whether passable cells connect two cells by their sides.

    Args:
        clear: where the robot fits, see `Clearance`; int8, shape (height, width), nothing is passable in its ring.
        start: flat number of a passable cell.
        goal: likewise.
    """
    width = clear.shape[1]
    cells = clear.reshape(-1)
    seen = np.zeros(len(cells), dtype=np.bool_)
    stack = np.empty(len(cells), dtype=np.int32)
    stack[0] = start
    seen[start] = True
    size = 1
    while size:
        size -= 1
        here = stack[size]
        if here == goal:
            return True
        for step in (1, -1, width, -width):
            there = here + step
            if not seen[there] and passable(cells[there]):
                seen[there] = True
                stack[size] = there
                size += 1
    return False


@njit(cache=True, nogil=True)
def _cells_between(clear: NDArray[np.int8], start: int, goal: int) -> NDArray[np.int32]:
    """Return the cells of a shortest way (A*; Hart, Nilsson, Raphael, 1968), the start first; none without a way.

    Steps lead from middle to middle, diagonal ones only between two cells that are passable as well.
    """
    width = clear.shape[1]
    cells = clear.reshape(-1)
    cost = np.full(len(cells), np.float32(np.inf), dtype=np.float32)
    before = np.full(len(cells), -1, dtype=np.int32)
    done = np.zeros(len(cells), dtype=np.bool_)
    room = 1024
    keys = np.empty(room, dtype=np.float32)
    items = np.empty(room, dtype=np.int32)
    cost[start] = 0.0
    size = push(keys, items, 0, np.float32(0.0), start)
    while size and not done[goal]:
        here = items[0]
        size = pop(keys, items, size)
        if done[here]:
            continue
        done[here] = True
        if size + 8 > room:
            room *= 2
            more_keys = np.empty(room, dtype=np.float32)
            more_items = np.empty(room, dtype=np.int32)
            copy_values(more_keys, keys[:size])
            copy_values(more_items, items[:size])
            keys, items = more_keys, more_items
        for down in (-width, 0, width):
            for across in (-1, 0, 1):
                there = here + down + across
                if there == here or done[there] or not passable(cells[there]):
                    continue
                length = 1.0
                if down and across:
                    if not (passable(cells[here + down]) and passable(cells[here + across])):
                        continue
                    length = _DIAGONAL
                total = np.float32(cost[here] + length)
                if total < cost[there]:
                    cost[there] = total
                    before[there] = here
                    dy, dx = abs(there // width - goal // width), abs(there % width - goal % width)
                    ahead = max(dy, dx) + (_DIAGONAL - 1.0) * min(dy, dx)
                    size = push(keys, items, size, np.float32(total + ahead), there)
    if not done[goal]:
        return np.empty(0, dtype=np.int32)
    count = 1
    here = goal
    while before[here] >= 0:
        here = before[here]
        count += 1
    way = np.empty(count, dtype=np.int32)
    here = goal
    for k in range(count - 1, -1, -1):
        way[k] = here
        here = before[here]
    return way


@njit(cache=True, nogil=True)
def _corners(clear: NDArray[np.int8], way: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the corners of a way of cells, subcells: it cuts across where all points on the line are clear.

    Elsewhere it leads from middle to middle, steps in the same direction together.
    """
    width = clear.shape[1]
    cells = clear.reshape(-1)
    count = len(way)
    points = np.empty((count, 2), dtype=np.int64)
    for k in range(count):
        points[k, 0] = ((way[k] % width) << SUBCELL_BITS) + SUBCELLS // 2
        points[k, 1] = ((way[k] // width) << SUBCELL_BITS) + SUBCELLS // 2
    corners = np.empty((count, 2), dtype=np.int64)
    corners[0, 0], corners[0, 1] = points[0, 0], points[0, 1]
    size = 1
    at = 0
    while at < count - 1:
        reached = at + 1
        while (
            reached < count - 1
            and blocker(cells, width, points[at, 0], points[at, 1], points[reached + 1, 0], points[reached + 1, 1])
            == CLEAR
        ):
            reached += 1
        if reached == at + 1:
            step = way[reached] - way[at]
            while reached < count - 1 and way[reached + 1] - way[reached] == step:
                reached += 1
        corners[size, 0], corners[size, 1] = points[reached, 0], points[reached, 1]
        size += 1
        at = reached
    return corners[:size].copy()


def cell_path(clear: NDArray[np.int8], start: int, goal: int) -> NDArray[np.int64]:
    """Return a short way between two passable cells that keeps the robot's radius (see `Clearance`).

    It takes a while in a large world: it is for when nothing else has found a way.

    Args:
        clear: where the robot fits, int8, shape (height, width), nothing is passable in its ring.
        start: flat number of a passable cell.
        goal: likewise.

    Returns:
        x and y of its corners, the middles of both cells included, subcells of the padded grid, int64, shape (n, 2);
        none without a way.
    """
    way = _cells_between(clear, start, goal)
    if not len(way):
        return np.empty((0, 2), dtype=np.int64)
    corners: NDArray[np.int64] = _corners(clear, way)
    return corners
