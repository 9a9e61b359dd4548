from __future__ import annotations

import itertools

import numpy as np
from common.planners.grid_search import EDGE_UNITS, NO_WAY, UNITS, a_star, straight_lengths
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from common.observation import NEIGHBOUR_COUNT, NEIGHBOUR_OFFSETS
from common.planners.incremental_search import IncrementalSearch


class Lattice:
    """A random lattice whose edges come and go."""

    def __init__(self, rows: int, columns: int, seed: int, blocked: float) -> None:
        self.random = np.random.default_rng(seed)
        self.shape = (rows, columns)
        self.edges = np.zeros(self.shape, dtype=np.uint32)
        for j, i, k in self.all_edges():
            if self.random.random() >= blocked:
                self.toggle(j, i, k)
        self.goal_units = np.full(rows * columns, NO_WAY, dtype=np.int64)
        self.goal = np.array([self.random.uniform(0, columns - 1), self.random.uniform(0, rows - 1)])
        self.straight = np.hypot(
            np.arange(columns)[None, :] - self.goal[0], np.arange(rows)[:, None] - self.goal[1]
        ).reshape(-1)
        for node in np.flatnonzero(self.straight <= 1.5):
            self.change_leg(int(node))

    def all_edges(self) -> list[tuple[int, int, int]]:
        rows, columns = self.shape
        return [
            (j, i, k)
            for j in range(rows)
            for i in range(columns)
            for k in range(NEIGHBOUR_COUNT // 2, NEIGHBOUR_COUNT)
            if 0 <= i + NEIGHBOUR_OFFSETS[k, 0] < columns and j + NEIGHBOUR_OFFSETS[k, 1] < rows
        ]

    def toggle(self, j: int, i: int, k: int) -> None:
        dx, dy = NEIGHBOUR_OFFSETS[k].tolist()
        self.edges[j, i] ^= np.uint32(1 << k)
        self.edges[j + dy, i + dx] ^= np.uint32(1 << (NEIGHBOUR_COUNT - 1 - k))

    def change_leg(self, node: int) -> None:
        leg = int(np.ceil(self.straight[node] * UNITS))
        self.goal_units[node] = leg if self.goal_units[node] == NO_WAY else NO_WAY

    @property
    def heuristic(self) -> NDArray[np.int64]:
        return np.maximum(np.floor(self.straight * UNITS).astype(np.int64) - 1, 0)

    def change(self, count: int) -> None:
        edges = self.all_edges()
        for index in self.random.choice(len(edges), size=min(count, len(edges)), replace=False):
            self.toggle(*edges[index])
        near = np.flatnonzero(self.straight <= 1.5)
        if len(near) and self.random.random() < 0.3:
            self.change_leg(int(self.random.choice(near)))

    def grow(self, down: int, left: int, up: int, right: int) -> None:
        """New rows and columns, tied to the old ones at random."""
        rows, columns = self.shape
        self.shape = (rows + down + up, columns + left + right)
        old = (self.edges, self.goal_units.reshape(rows, columns))
        self.edges = np.zeros(self.shape, dtype=np.uint32)
        self.edges[down : down + rows, left : left + columns] = old[0]
        goal_units = np.full(self.shape, NO_WAY, dtype=np.int64)
        goal_units[down : down + rows, left : left + columns] = old[1]
        self.goal_units = goal_units.reshape(-1)
        self.goal = self.goal + np.array([left, down])
        self.straight = np.hypot(
            np.arange(self.shape[1])[None, :] - self.goal[0], np.arange(self.shape[0])[:, None] - self.goal[1]
        ).reshape(-1)
        inside = np.zeros(self.shape, dtype=np.bool_)
        inside[down : down + rows, left : left + columns] = True
        for j, i, k in self.all_edges():
            dx, dy = NEIGHBOUR_OFFSETS[k].tolist()
            if not (inside[j, i] and inside[j + dy, i + dx]) and self.random.random() < 0.5:
                self.toggle(j, i, k)


def length_of(lattice: Lattice, path: list[int]) -> int:
    """Walk a path, each edge of which must be there."""
    total = 0
    columns = lattice.shape[1]
    for a, b in itertools.pairwise(path):
        step = [b % columns - a % columns, b // columns - a // columns]
        k = NEIGHBOUR_OFFSETS.tolist().index(step)
        assert lattice.edges[a // columns, a % columns] >> k & 1
        total += int(EDGE_UNITS[k])
    return total + int(lattice.goal_units[path[-1]])


def check(lattice: Lattice, search: IncrementalSearch, start: int) -> list[int]:
    repaired = search.replan(lattice.edges, lattice.goal_units, start)
    fresh, path, _ = a_star(lattice.edges, lattice.goal_units, lattice.heuristic, start)
    assert repaired == fresh
    ways = (path, search.path())
    for way in ways:
        assert bool(way) == (fresh < NO_WAY)
        if way:
            assert way[0] == start
            assert length_of(lattice, way) == fresh
    return ways[1]


@settings(max_examples=150, deadline=None)
@given(
    rows=st.integers(1, 14),
    columns=st.integers(2, 14),
    seed=st.integers(0, 2**32 - 1),
    blocked=st.sampled_from([0.0, 0.3, 0.6, 0.8, 0.9, 1.0]),
    changes=st.lists(st.integers(0, 30), min_size=1, max_size=12),
    jumps=st.booleans(),
)
def test_repairing_gives_what_a_fresh_search_gives_after_every_change(
    rows: int, columns: int, seed: int, blocked: float, changes: list[int], jumps: bool
) -> None:
    lattice = Lattice(rows, columns, seed, blocked)
    search = IncrementalSearch(lattice.shape)
    start = int(lattice.random.integers(rows * columns))
    for count in changes:
        path = check(lattice, search, start)
        if len(path) > 1:
            start = path[1]
        if jumps and lattice.random.random() < 0.3:
            start = int(lattice.random.integers(rows * columns))
        lattice.change(count)
    check(lattice, search, start)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    growths=st.lists(st.tuples(*[st.integers(0, 3)] * 4), min_size=1, max_size=4),
)
def test_a_lattice_that_grows_keeps_what_was_searched(seed: int, growths: list[tuple[int, int, int, int]]) -> None:
    lattice = Lattice(5, 6, seed, 0.5)
    search = IncrementalSearch(lattice.shape)
    start = 7
    check(lattice, search, start)
    for down, left, up, right in growths:
        j, i = divmod(start, lattice.shape[1])
        lattice.grow(down, left, up, right)
        lattice.change(4)
        start = (j + down) * lattice.shape[1] + i + left
        search.extend(lattice.shape, down, left)
        path = check(lattice, search, start)
        start = path[1] if len(path) > 1 else start


def test_lengths_round_up_and_obey_the_triangle_inequality() -> None:
    lengths = straight_lengths(40, 40)
    y, x = np.mgrid[:40, :40]
    assert np.all(lengths >= np.hypot(y, x) * UNITS - 1e-6)
    assert np.all(lengths < np.hypot(y, x) * UNITS + 1 + 1e-6)
    assert lengths[0, 7] == 7 * UNITS
    for (ay, ax), (by, bx) in np.random.default_rng(0).integers(0, 20, (500, 2, 2)):
        assert lengths[ay + by, ax + bx] <= lengths[ay, ax] + lengths[by, bx]


def test_one_blocked_edge_far_from_the_path_costs_no_expansion() -> None:
    lattice = Lattice(20, 20, 1, 0.0)
    lattice.goal_units[:] = NO_WAY
    lattice.goal_units[5] = 0
    search = IncrementalSearch(lattice.shape)
    search.replan(lattice.edges, lattice.goal_units, 2)
    before = search.expanded
    lattice.toggle(15, 15, 10)
    search.replan(lattice.edges, lattice.goal_units, 3)
    assert search.expanded == before


def test_repairing_expands_fewer_vertices_than_searching_anew() -> None:
    lattice = Lattice(40, 40, 2, 0.4)
    search = IncrementalSearch(lattice.shape)
    start = 39 * 40 + 39
    fresh = repaired = 0
    path = check(lattice, search, start)
    for _ in range(20):
        start = path[1] if len(path) > 1 else start
        # What a robot learns lies around it.
        j, i = divmod(start, 40)
        for a, b, k in lattice.all_edges():
            near = abs(a - j) <= 3 and abs(b - i) <= 3 and a < 38
            if near and lattice.edges[a, b] >> k & 1 and lattice.random.random() < 0.05:
                lattice.toggle(a, b, k)
        before = search.expanded
        path = check(lattice, search, start)
        repaired += search.expanded - before
        anew = IncrementalSearch(lattice.shape)
        anew.replan(lattice.edges, lattice.goal_units, start)
        fresh += anew.expanded
    assert repaired < 0.7 * fresh
