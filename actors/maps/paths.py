"""Shortest ways on the true map, for statistics."""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

from common.system.jit import njit

_COARSE = 4
# Unit and knight's moves: lengths are at most 2.7 % above the straight line.
_MOVES = np.array(
    [
        (dy, dx)
        for dy in range(-2, 3)
        for dx in range(-2, 3)
        if (abs(dy), abs(dx)) in {(0, 1), (1, 0), (1, 1), (1, 2), (2, 1)}
    ],
    dtype=np.int64,
)


@njit(cache=True, nogil=True)
def _dijkstra(free: NDArray[np.bool_], first: int, last: int, moves: NDArray[np.int64]) -> float:
    rows, columns = free.shape
    best = np.full(rows * columns, np.inf)
    best[first] = 0.0
    heap = [(0.0, first)]
    while len(heap) > 0:
        length, cell = heapq.heappop(heap)
        if cell == last:
            return length
        if length > best[cell]:
            continue
        row, column = cell // columns, cell % columns
        for k in range(len(moves)):
            dy, dx = moves[k, 0], moves[k, 1]
            y, x = row + dy, column + dx
            if y < 0 or x < 0 or y >= rows or x >= columns or not free[y, x]:
                continue
            # A diagonal or knight's move needs every cell that its line crosses.
            clear = True
            for step_y in range(min(row, y), max(row, y) + 1):
                for step_x in range(min(column, x), max(column, x) + 1):
                    if not free[step_y, step_x]:
                        clear = False
            if not clear:
                continue
            further = length + np.sqrt(float(dy * dy + dx * dx))
            if further < best[y * columns + x]:
                best[y * columns + x] = further
                heapq.heappush(heap, (further, y * columns + x))
    return np.inf


def shortest_distance(free: NDArray[np.bool_], start: tuple[int, int], target: tuple[int, int]) -> float:
    """Return the length of the shortest way between two cells.

    Args:
        free: bool, shape (rows, columns).
        start: (row, column) of a free cell.
        target: likewise.

    Returns:
        Cells; at most 3 % too long beside the detour around corners; infinite without a way. The search runs on
        squares of four cells, and on single cells where those are too coarse to find a way.
    """
    rows, columns = free.shape[0] // _COARSE, free.shape[1] // _COARSE
    squares = free[: rows * _COARSE, : columns * _COARSE].reshape(rows, _COARSE, columns, _COARSE)
    coarse = np.ascontiguousarray(squares.all(axis=(1, 3)))
    ends = [(row // _COARSE, column // _COARSE) for row, column in (start, target)]
    if all(row < rows and column < columns and coarse[row, column] for row, column in ends):
        first, last = (row * columns + column for row, column in ends)
        found = float(_dijkstra(coarse, first, last, _MOVES)) * _COARSE
        if np.isfinite(found):
            return found
    width = free.shape[1]
    return float(
        _dijkstra(
            np.ascontiguousarray(free),
            start[0] * width + start[1],
            target[0] * width + target[1],
            _MOVES,
        )
    )
