from __future__ import annotations

import heapq

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.mapping.raycast import SUBCELLS
from common.mapping.sight import FREE, OCCUPIED
from common.planners.navigation.visibility_graph import VisibilityGraph
from tests.effort import examples

Cells = np.ndarray


def everything(cells: Cells) -> tuple[int, int, int, int]:
    return 0, cells.shape[0] - 1, 0, cells.shape[1] - 1


def graph_of(cells: Cells) -> VisibilityGraph:
    graph = VisibilityGraph()
    graph.update(cells, everything(cells))
    return graph


def place(x: float, y: float) -> tuple[int, int]:
    return round(x * SUBCELLS), round(y * SUBCELLS)


def edges(graph: VisibilityGraph) -> set[frozenset[tuple[int, ...]]]:
    rows = [tuple(row) for row in graph.corners.tolist()]
    return {frozenset((rows[a], rows[b])) for a, b in np.argwhere(graph.visible).tolist()}


def test_the_way_round_a_wall_bends_at_its_ends() -> None:
    cells = np.full((40, 40), FREE, dtype=np.int8)
    cells[10:30, 20] = OCCUPIED
    length, path = graph_of(cells).path(cells, place(10.5, 20.5), place(30.5, 20.5))
    graph = graph_of(cells)
    corners = graph.corners[path, :2].tolist()
    # One cell beyond the end of the wall, on both sides of it; the lower end is the nearer one.
    assert corners in ([[19, 9], [22, 9]], [[19, 31], [22, 31]])
    bends = np.array([[10.5, 20.5], *corners, [30.5, 20.5]])
    assert length == pytest.approx(float(np.hypot(*np.diff(bends, axis=0).T).sum()))


def test_a_sealed_place_has_no_way_in() -> None:
    cells = np.full((40, 40), FREE, dtype=np.int8)
    cells[10:30, 10] = cells[10:30, 29] = cells[10, 10:30] = cells[29, 10:30] = OCCUPIED
    length, path = graph_of(cells).path(cells, place(5.5, 5.5), place(20.5, 20.5))
    assert length == np.inf
    assert len(path) == 0


def test_gaps_between_single_returns_are_no_way_through_for_vertices() -> None:
    cells = np.full((40, 40), FREE, dtype=np.int8)
    cells[10:30:3, 20] = OCCUPIED
    graph = graph_of(cells)
    # One polygon, not seven.
    assert len(graph.corners) == 4


@settings(max_examples=examples(40), deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    boxes=st.lists(
        st.tuples(st.integers(3, 30), st.integers(3, 30), st.integers(1, 6), st.integers(1, 6), st.booleans()),
        min_size=1,
        max_size=12,
    ),
)
def test_correcting_a_graph_gives_what_making_it_anew_gives(
    seed: int, boxes: list[tuple[int, int, int, int, bool]]
) -> None:
    random = np.random.default_rng(seed)
    cells = np.full((40, 40), FREE, dtype=np.int8)
    cells[3:37, 3:37][random.random((34, 34)) < 0.03] = OCCUPIED
    graph = graph_of(cells)
    for row, column, height, width, wall in boxes:
        row_end, column_end = min(row + height, 37), min(column + width, 37)
        cells[row:row_end, column:column_end] = OCCUPIED if wall else FREE
        graph.update(cells, (row, row_end - 1, column, column_end - 1))
        fresh = graph_of(cells)
        assert np.array_equal(graph.corners, fresh.corners)
        assert edges(graph) == edges(fresh)


def test_a_change_far_away_tests_few_segments() -> None:
    cells = np.full((200, 200), FREE, dtype=np.int8)
    random = np.random.default_rng(5)
    for row, column in random.integers(10, 150, (60, 2)).tolist():
        cells[row : row + 4, column : column + 4] = OCCUPIED
    graph = graph_of(cells)
    all_of_them = graph.tested
    cells[190:192, 190:192] = OCCUPIED
    graph.update(cells, (190, 191, 190, 191))
    assert graph.tested < 0.2 * all_of_them
    assert graph.kept == len(graph.corners) - 4


def lattice_length(cells: Cells, start: tuple[int, int], goal: tuple[int, int]) -> float:
    """Length of a shortest path over the sides and diagonals of free cells; infinite without one."""
    best = {start: 0.0}
    heap = [(0.0, start)]
    while heap:
        length, (row, column) = heapq.heappop(heap)
        if (row, column) == goal:
            return length
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                there = (row + dy, column + dx)
                part = cells[
                    min(row, row + dy) : max(row, row + dy) + 1, min(column, column + dx) : max(column, column + dx) + 1
                ]
                inside = 0 <= there[0] < cells.shape[0] and 0 <= there[1] < cells.shape[1]
                if inside and not part.any() and length + np.hypot(dx, dy) < best.get(there, np.inf):
                    best[there] = length + float(np.hypot(dx, dy))
                    heapq.heappush(heap, (best[there], there))
    return np.inf


@settings(max_examples=examples(40), deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_paths_are_about_as_short_as_they_can_be(seed: int) -> None:
    """Never longer than eight directions make them, but for the cell of room beside each obstacle."""
    random = np.random.default_rng(seed)
    cells = np.full((48, 48), FREE, dtype=np.int8)
    # Blocks that are far enough from each other for the robot to pass.
    for row in range(6, 42, 9):
        for column in range(6, 42, 9):
            if random.random() < 0.7:
                height, width = random.integers(1, 6, 2).tolist()
                cells[row : row + height, column : column + width] = OCCUPIED
    free = np.argwhere(cells == FREE)
    start, goal = (tuple(free[k].tolist()) for k in random.choice(len(free), 2, replace=False))
    ends = [place(column + 0.5, row + 0.5) for row, column in (start, goal)]
    length, path = graph_of(cells).path(cells, ends[0], ends[1])
    reference = lattice_length(cells, start, goal)
    assert np.isfinite(reference)
    straight = float(np.hypot(start[0] - goal[0], start[1] - goal[1]))
    assert straight - 1e-6 <= length <= 1.02 * reference + 4.0
    assert bool(len(path)) == (length > straight + 1e-6)
