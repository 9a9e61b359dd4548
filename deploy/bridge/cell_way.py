"""A way from cell to cell, for the few places that lie between the viewpoints."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.mapping.mapper import Mapper
from common.planners.base import Position
from common.system.jit import njit

# Straight neighbours first, so that ways are straight where they can be.
_STEPS: Final = np.array([(1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)], dtype=np.int64)


def nearest_way(
    mapper: Mapper, start: Position, passable: NDArray[np.bool_], goals: NDArray[np.bool_]
) -> list[Position]:
    """Return the way to the goal that takes the fewest steps, pulled straight where lines are free.

    Args:
        mapper: of this moment.
        start: of the way, metres.
        passable: cells that it may lead through, bool, shape of the belief's padded grid; the start may lie beside.
        goals: cells to get to, likewise.

    Returns:
        Corners, the goal last, metres; at least one, or none where no way leads to a goal.
    """
    trail = cells_between(mapper, start, passable, goals)
    return _pulled_straight(mapper, start, [centre_of(mapper, cell) for cell in trail])


def cells_between(mapper: Mapper, start: Position, passable: NDArray[np.bool_], goals: NDArray[np.bool_]) -> list[int]:
    """Return the cells of that way, flat, the goal last."""
    belief = mapper.belief
    width = belief.padded.shape[1]
    (row, column), (rows, columns) = belief.cell(start), belief.shape
    if not (0 <= row < rows and 0 <= column < columns):
        return []
    first = (row + 1) * width + column + 1
    goal, before = _flood(passable.reshape(-1), width, first, goals.reshape(-1))
    if goal < 0:
        return []
    trail = [int(goal)]
    while before[trail[-1]] != first and trail[-1] != first:
        trail.append(int(before[trail[-1]]))
    return trail[::-1]


def pieces(passable: NDArray[np.bool_], seeds: NDArray[np.bool_], most: int) -> Iterator[NDArray[np.bool_]]:
    """Yield the largest pieces of a padded grid that hold a seed, in the order of their first seeds.

    Args:
        passable: cells of pieces, bool, shape of the grid; no diagonal step leads between two others.
        seeds: some of them, likewise.
        most: pieces to yield.

    Yields:
        bool, shape of the grid.
    """
    cells, starts = _pieces(passable.reshape(-1), passable.shape[1], seeds.reshape(-1))
    sizes = np.diff(starts)
    for k in np.sort(np.argsort(-sizes, kind="stable")[:most]).tolist():
        piece = np.zeros(passable.shape, dtype=np.bool_)
        piece.reshape(-1)[cells[starts[k] : starts[k + 1]]] = True
        yield piece


def centre_of(mapper: Mapper, cell: int) -> Position:
    """Return the middle of a cell of the padded grid, given flat, metres."""
    row, column = divmod(cell, mapper.belief.padded.shape[1])
    (x, y), size = mapper.belief.origin, mapper.belief.resolution
    return x + (column - 0.5) * size, y + (row - 0.5) * size


@njit(cache=True, nogil=True)
def _flood(
    passable: NDArray[np.bool_], width: int, start: int, goals: NDArray[np.bool_]
) -> tuple[int, NDArray[np.int32]]:
    """Flood passable cells of a padded grid from a cell until a goal is reached.

    Returns:
        Flat index of the goal, -1 when none is reached; and of the cell before each, int32, shape (cells,).
    """
    before = np.full(len(passable), -1, dtype=np.int32)
    queue = np.empty(len(passable), dtype=np.int32)
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
            if before[there] >= 0 or not passable[there]:
                continue
            if k >= 4 and not (passable[here + dx] and passable[here + dy * width]):
                continue
            before[there] = here
            queue[tail] = there
            tail += 1
    return -1, before


@njit(cache=True, nogil=True)
def _pieces(
    passable: NDArray[np.bool_], width: int, seeds: NDArray[np.bool_]
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return the flat cells of each piece with a seed, one piece behind the other, and the first of each, then all."""
    left = passable.copy()
    queue = np.empty(len(passable), dtype=np.int32)
    starts = [np.int64(0)]
    head = tail = 0
    for seed in range(len(passable)):
        if not (seeds[seed] and left[seed]):
            continue
        left[seed] = False
        queue[tail] = seed
        tail += 1
        while head < tail:
            here = queue[head]
            head += 1
            for k in range(8):
                dx, dy = _STEPS[k]
                there = here + dy * width + dx
                if not left[there]:
                    continue
                if k >= 4 and not (passable[here + dx] and passable[here + dy * width]):
                    continue
                left[there] = False
                queue[tail] = there
                tail += 1
        starts.append(np.int64(tail))
    return queue[:tail].copy(), np.array(starts)


def _pulled_straight(mapper: Mapper, start: Position, places: list[Position]) -> list[Position]:
    """Leave out places between two that are joined by a straight free line."""
    corners: list[Position] = []
    here, k = start, 0
    while k < len(places):
        # The next cell itself may not be in a free line from a robot in a corner: it is gone to all the same.
        farthest = k
        for j in range(k, len(places)):
            if not mapper.segment_free(here, places[j]):
                break
            farthest = j
        corners.append(places[farthest])
        here, k = places[farthest], farthest + 1
    return corners
