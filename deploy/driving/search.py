"""A way through the local costmap when the path itself is blocked: A* over its cells."""

from __future__ import annotations

from math import hypot, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.system.heap import pop, push
from common.system.jit import njit
from deploy.driving.costmap import Field, LocalCostmap

Position = tuple[float, float]
# A metre close to obstacles costs as much as so many more metres far from them.
_NEAR_COST: Final = 2.0


def find_way(costmap: LocalCostmap, start: Position, goal: Position) -> list[Position]:
    """Return positions from start to goal that keep the costmap's room, metres; empty when there is no way.

    Where the start is nearer to an obstacle than that, the way out of there counts as free.
    """
    if not costmap.contains(np.array((start, goal))).all():
        return []
    field = costmap.field
    left, bottom, size = field.left, field.bottom, field.resolution
    (sx, sy), (gx, gy) = ((int((x - left) / size), int((y - bottom) / size)) for x, y in (start, goal))
    cells = _search(field, sy, sx, gy, gx, costmap.passage)
    if not len(cells):
        return []
    columns = field.distances.shape[1]
    middle = [(left + (cell % columns + 0.5) * size, bottom + (cell // columns + 0.5) * size) for cell in cells]
    return [start, *middle[1:-1], goal]


@njit(cache=True, nogil=True)
def _search(
    field: Field, start_row: int, start_column: int, goal_row: int, goal_column: int, room: float
) -> NDArray[np.int64]:
    distances, size = field.distances, field.resolution
    rows, columns = distances.shape
    count = rows * columns
    costs = np.full(count, np.inf)
    parents = np.full(count, -1, dtype=np.int64)
    closed = np.zeros(count, dtype=np.bool_)
    keys = np.empty(8 * count)
    items = np.empty(8 * count, dtype=np.int64)
    start, goal = start_row * columns + start_column, goal_row * columns + goal_column
    tolerated = min(room, distances[start_row, start_column] - size)
    costs[start] = 0.0
    length = push(keys, items, 0, 0.0, start)
    while length > 0:
        node = items[0]
        length = pop(keys, items, length)
        if closed[node]:
            continue
        closed[node] = True
        if node == goal:
            break
        row, column = node // columns, node % columns
        for down in range(-1, 2):
            for right in range(-1, 2):
                r, c = row + down, column + right
                if (down == 0 and right == 0) or r < 0 or c < 0 or r >= rows or c >= columns:
                    continue
                other = r * columns + c
                distance = distances[r, c]
                if closed[other] or distance < room:
                    leaving = hypot(r - start_row, c - start_column) * size <= room + size
                    if closed[other] or not leaving or distance < tolerated:
                        continue
                near = min(max((field.cap - distance) / (field.cap - room), 0.0), 1.0)
                step = sqrt(float(down * down + right * right)) * size * (1.0 + _NEAR_COST * near * near)
                cost = costs[node] + step
                if cost < costs[other]:
                    costs[other] = cost
                    parents[other] = node
                    estimate = hypot(r - goal_row, c - goal_column) * size
                    length = push(keys, items, length, cost + estimate, other)
    if not closed[goal]:
        return np.empty(0, dtype=np.int64)
    size_of_way = 1
    node = goal
    while node != start:
        node = parents[node]
        size_of_way += 1
    way = np.empty(size_of_way, dtype=np.int64)
    node = goal
    for index in range(size_of_way - 1, -1, -1):
        way[index] = node
        node = parents[node]
    return way
