from __future__ import annotations

import heapq

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from common.mapping.clearance import sweep
from common.mapping.raycast import SUBCELLS
from common.planners.navigation.cell_path import cell_path, connected
from tests.common.planners.clear import clear_space
from tests.effort import examples

Cells = NDArray[np.int8]


def steps(clear: Cells, cell: int) -> list[tuple[int, float]]:
    """Where one can go from a cell: to passable ones around, not between two that touch in a corner."""
    width = clear.shape[1]
    flat = clear.reshape(-1)
    found = []
    for down in (-width, 0, width):
        for across in (-1, 0, 1):
            beside = all(flat[k] in (0, 1) for k in (cell + down, cell + across))
            if (down or across) and flat[cell + down + across] in (0, 1) and beside:
                found.append((cell + down + across, float(np.hypot(bool(down), bool(across)))))
    return found


def reference(clear: Cells, start: int, goal: int) -> float:
    """Length of a shortest way of steps, cells; infinite without one."""
    best = {start: 0.0}
    heap = [(0.0, start)]
    while heap:
        length, here = heapq.heappop(heap)
        if here == goal:
            return length
        for there, step in steps(clear, here):
            if length + step < best.get(there, np.inf) - 1e-9:
                best[there] = length + step
                heapq.heappush(heap, (length + step, there))
    return np.inf


@settings(max_examples=examples(120))
@given(
    seed=st.integers(0, 2**32 - 1),
    rows=st.integers(3, 24),
    columns=st.integers(3, 24),
    walls=st.sampled_from([0.02, 0.05, 0.1, 0.25, 0.4]),
    radius=st.sampled_from([0.0, 0.8, 1.5, 2.5]),
)
def test_ways_are_short_and_keep_the_radius(seed: int, rows: int, columns: int, walls: float, radius: float) -> None:
    random = np.random.default_rng(seed)
    belief = np.where(random.random((rows, columns)) < walls, np.int8(100), np.int8(0))
    padded, clear = clear_space(belief, radius)
    passable = np.flatnonzero((clear.reshape(-1) == 0) | (clear.reshape(-1) == 1))
    if not len(passable):
        return
    start, goal = (int(passable[k]) for k in random.integers(len(passable), size=2))
    expected = reference(clear, start, goal)
    way = cell_path(clear, start, goal)
    assert connected(clear, start, goal) == np.isfinite(expected) == bool(len(way))
    if not len(way):
        return
    width = clear.shape[1]
    for cell, corner in ((start, way[0]), (goal, way[-1])):
        assert corner.tolist() == [cell % width * SUBCELLS + SUBCELLS // 2, cell // width * SUBCELLS + SUBCELLS // 2]
    length = 0.0
    for a, b in zip(way[:-1] / SUBCELLS, way[1:] / SUBCELLS, strict=True):
        length += float(np.hypot(*(b - a)))
        assert sweep(padded.reshape(-1), width, *a, *b, radius + 1.0) >= radius - 1e-6
    assert length <= expected + 5e-3


def test_across_an_empty_room_the_way_is_straight() -> None:
    _, clear = clear_space(np.zeros((20, 30), dtype=np.int8), 1.0)
    width = clear.shape[1]
    assert len(cell_path(clear, 3 * width + 3, 15 * width + 25)) == 2


@pytest.mark.parametrize(("gap", "open_"), [(1, False), (2, False), (3, True), (4, True)])
def test_a_gap_lets_through_what_fits(gap: int, open_: bool) -> None:
    """A disc of 1.5 cells needs three."""
    cells = np.zeros((20, 21), dtype=np.int8)
    cells[:, 10] = 100
    cells[8 : 8 + gap, 10] = 0
    _, clear = clear_space(cells, 1.5)
    ends = 10 * clear.shape[1] + 5, 10 * clear.shape[1] + 16
    assert connected(clear, *ends) == open_
    assert bool(len(cell_path(clear, *ends))) == open_
