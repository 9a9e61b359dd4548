"""Paths through clear space from one viewpoint to a neighbour that is not in sight, inside their two pieces."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from common.mapping.pieces import Cells
from common.mapping.raycast import SUBCELL_BITS, cell_middle
from common.mapping.sight import CLEAR, blocker
from common.mapping.squares import Layout
from common.system.heap import pop, push
from common.system.jit import njit

_DIAGONAL: Final = 2.0**0.5


@njit(cache=True, nogil=True)
def _cells_between(
    cells: Cells, layout: Layout, square_a: int, label_a: int, square_b: int, label_b: int, start: int, goal: int
) -> NDArray[np.int32]:
    """Return the cells of a shortest way inside two pieces (A*; Hart, Nilsson, Raphael, 1968), goal first.

    Steps lead from middle to middle, diagonal ones only between two cells that are open as well.
    """
    width = cells.width
    columns = len(layout.x)
    ja, ia, jb, ib = square_a // columns, square_a % columns, square_b // columns, square_b % columns
    top, left = layout.row_begin[min(ja, jb)] - 1, layout.column_begin[min(ia, ib)] - 1
    rows = layout.row_begin[max(ja, jb) + 1] - top + 1
    span = layout.column_begin[max(ia, ib) + 1] - left + 1
    # A window around both squares with a closed ring.
    open_cells = np.zeros(rows * span, dtype=np.bool_)
    for square, label in ((square_a, label_a), (square_b, label_b)):
        j, i = square // columns, square % columns
        for row in range(layout.row_begin[j], layout.row_begin[j + 1]):
            for column in range(layout.column_begin[i], layout.column_begin[i + 1]):
                if cells.labels[row * width + column] == label:
                    open_cells[(row - top) * span + column - left] = True
    cost = np.full(rows * span, np.inf)
    before = np.full(rows * span, -1, dtype=np.int32)
    done = np.zeros(rows * span, dtype=np.bool_)
    keys = np.empty(8 * rows * span + 1)
    items = np.empty(8 * rows * span + 1, dtype=np.int32)
    source = (start // width - top) * span + start % width - left
    target = (goal // width - top) * span + goal % width - left
    target_row, target_column = target // span, target % span
    cost[source] = 0.0
    size = push(keys, items, 0, 0.0, source)
    while size:
        here = items[0]
        size = pop(keys, items, size)
        if done[here]:
            continue
        done[here] = True
        if here == target:
            break
        for down in (-span, 0, span):
            for across in (-1, 0, 1):
                there = here + down + across
                if there == here or not open_cells[there] or done[there]:
                    continue
                length = 1.0
                if down and across:
                    if not (open_cells[here + down] and open_cells[here + across]):
                        continue
                    length = _DIAGONAL
                total = cost[here] + length
                if total < cost[there]:
                    cost[there] = total
                    before[there] = here
                    dy, dx = abs(there // span - target_row), abs(there % span - target_column)
                    ahead = max(dy, dx) + (_DIAGONAL - 1.0) * min(dy, dx)
                    size = push(keys, items, size, total + ahead, there)
    count = 0
    here = target
    while here >= 0:
        count += 1
        here = before[here]
    way = np.empty(count, dtype=np.int32)
    here = target
    for k in range(count):
        way[k] = (here // span + top) * width + here % span + left
        here = before[here]
    return way


@njit(cache=True, nogil=True)
def way_inside(
    cells: Cells,
    layout: Layout,
    square_a: int,
    label_a: int,
    square_b: int,
    label_b: int,
    start: tuple[int, int],
    goal: tuple[int, int],
) -> NDArray[np.int64]:
    """Return the corners of a short way through two pieces that touch, or through one.

    It keeps the robot's radius: each part is either a straight segment through cells that are clear at all points, or
    a step between the middles of neighbouring clear cells (see `Clearance`).

    Args:
        cells: of the belief.
        layout: of the squares.
        square_a: square of the piece that holds the start.
        label_a: number of that piece.
        square_b: square of the piece that holds the goal, the same or a neighbour.
        label_b: number of that piece.
        start: subcells.
        goal: subcells.

    Returns:
        x and y from start to goal, both included, subcells, int64, shape (corners, 2).
    """
    width = cells.width
    first = (start[1] >> SUBCELL_BITS) * width + (start[0] >> SUBCELL_BITS)
    last = (goal[1] >> SUBCELL_BITS) * width + (goal[0] >> SUBCELL_BITS)
    way = _cells_between(cells, layout, square_a, label_a, square_b, label_b, first, last)[::-1]
    # Points that the way leads through: the start, the middles of all cells, the goal.
    count = len(way) + 2
    points = np.empty((count, 2), dtype=np.int64)
    points[0, 0], points[0, 1] = start
    points[count - 1, 0], points[count - 1, 1] = goal
    for k in range(len(way)):
        points[k + 1, 0], points[k + 1, 1] = cell_middle(way[k], width)
    corners = np.empty((count, 2), dtype=np.int64)
    corners[0, 0], corners[0, 1] = points[0, 0], points[0, 1]
    size = 1
    at = 0
    while at < count - 1:
        reached = at + 1
        for k in range(at + 2, count):
            if blocker(cells.clear, width, points[at, 0], points[at, 1], points[k, 0], points[k, 1]) == CLEAR:
                reached = k
        # Steps on in the same direction are one segment.
        if reached == at + 1:
            dx, dy = points[reached, 0] - points[at, 0], points[reached, 1] - points[at, 1]
            while reached < count - 1 and (
                points[reached + 1, 0] - points[reached, 0] == dx and points[reached + 1, 1] - points[reached, 1] == dy
            ):
                reached += 1
        corners[size, 0], corners[size, 1] = points[reached, 0], points[reached, 1]
        if points[reached, 0] != points[at, 0] or points[reached, 1] != points[at, 1]:
            size += 1
        at = reached
    return corners[:size].copy()


@njit(cache=True, nogil=True)
def length_of(corners: NDArray[np.int64]) -> float:
    """Return the length of a way, subcells."""
    total = 0.0
    for k in range(1, len(corners)):
        total += np.hypot(float(corners[k, 0] - corners[k - 1, 0]), float(corners[k, 1] - corners[k - 1, 1]))
    return total


@njit(cache=True, nogil=True)
def way_between(pieces: Any, cells: Cells, layout: Layout, a: int, b: int) -> NDArray[np.int64]:
    """Return the corners of the way from the viewpoint of a piece to that of a piece that it touches."""
    p, q = pieces[a], pieces[b]
    # As wide as Python's, so that the kernel is compiled for one kind of integer.
    square_a, label_a, square_b, label_b = np.int64(p.square), np.int64(p.label), np.int64(q.square), np.int64(q.label)
    return way_inside(cells, layout, square_a, label_a, square_b, label_b, (p.x, p.y), (q.x, q.y))
