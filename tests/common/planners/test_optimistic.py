from __future__ import annotations

import numpy as np
import pytest
from common.planners.grid_search import NO_WAY, UNITS
from hypothesis import given, settings
from hypothesis import strategies as st

from common.mapping.belief import Belief
from common.mapping.sight import FREE, OCCUPIED, UNKNOWN
from common.observation import NEIGHBOUR_COUNT, NEIGHBOUR_OFFSETS
from common.planners.optimistic import OptimisticGrid, OptimisticLattice

SPACING = 2.0
CHOICES = np.array([UNKNOWN, FREE, FREE, FREE, OCCUPIED], dtype=np.int8)


def belief_of(cells: np.ndarray, origin: tuple[float, float] = (0.0, 0.0)) -> Belief:
    belief = Belief(0.5, 5.0)
    belief.assign(cells, origin)
    return belief


def test_unknown_cells_may_be_free_and_occupied_ones_may_not() -> None:
    cells = np.full((8, 8), UNKNOWN, dtype=np.int8)
    cells[4, 4] = OCCUPIED
    grid = OptimisticGrid(2.0)
    grid.update(belief_of(cells))
    assert grid.possibly_free((0.25, 0.25), (3.75, 0.25))
    assert not grid.free((0.25, 0.25), (3.75, 0.25))
    assert not grid.possibly_free((0.25, 2.25), (3.75, 2.25))
    # Beyond the belief, too.
    assert grid.possibly_free((-1.5, -1.5), (5.5, -1.5))


def test_changes_are_told_as_a_box() -> None:
    belief = belief_of(np.full((8, 8), UNKNOWN, dtype=np.int8))
    grid = OptimisticGrid(1.0)
    assert grid.update(belief) == (0, 11, 0, 11)
    assert grid.resized
    assert grid.update(belief) is None
    belief.assign(np.full((1, 2), OCCUPIED, dtype=np.int8), (1.0, 1.5))
    assert grid.update(belief) == (5, 5, 4, 5)
    assert not grid.resized


def test_a_belief_that_grows_moves_the_rectangle() -> None:
    belief = belief_of(np.full((4, 4), FREE, dtype=np.int8))
    grid = OptimisticGrid(1.0)
    grid.update(belief, (5.0, 1.0))
    assert grid.known.shape == (8, 14)
    belief.assign(np.full((4, 4), OCCUPIED, dtype=np.int8), (-2.0, -2.0))
    grid.update(belief, (5.0, 1.0))
    assert grid.resized
    assert grid.origin == (-3.0, -3.0)
    assert not grid.possibly_free((-1.0, -1.0), (-0.5, -1.0))
    assert grid.free((0.5, 0.5), (1.5, 0.5))


def test_a_doubtful_cell_counts_as_occupied_until_it_is_known_to_be_free() -> None:
    belief = belief_of(np.full((8, 8), UNKNOWN, dtype=np.int8))
    grid = OptimisticGrid(1.0)
    grid.update(belief)
    grid.doubt((2.1, 2.1))
    grid.doubt((3.1, 3.1), always=True)
    assert grid.possibly_free((2.1, 2.1), (2.1, 2.1))
    assert grid.update(belief) == (6, 8, 6, 8)
    assert not grid.possibly_free((2.1, 2.1), (2.1, 2.1))
    belief.assign(np.full((8, 8), FREE, dtype=np.int8), (0.0, 0.0))
    grid.update(belief)
    assert grid.possibly_free((2.1, 2.1), (2.1, 2.1))
    assert not grid.possibly_free((3.1, 3.1), (3.1, 3.1))


def expected_edges(lattice: OptimisticLattice, scanned: set[int], closed: set[int]) -> np.ndarray:
    """Every edge by itself."""
    rows, columns = lattice.shape
    edges = np.zeros((rows, columns), dtype=np.uint32)
    for node in range(rows * columns):
        for k in range(NEIGHBOUR_COUNT):
            dx, dy = NEIGHBOUR_OFFSETS[k].tolist()
            j, i = divmod(node, columns)
            if not (0 <= j + dy < rows and 0 <= i + dx < columns):
                continue
            other = (j + dy) * columns + i + dx
            if closed & {node, other}:
                continue
            ends = lattice.position(node), lattice.position(other)
            free = lattice.grid.free if scanned & {node, other} else lattice.grid.possibly_free
            if free(*ends):
                edges[j, i] |= np.uint32(1 << k)
    return edges


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_edges_follow_the_belief_wherever_it_changes(seed: int) -> None:
    random = np.random.default_rng(seed)
    belief = belief_of(random.choice(CHOICES, (20, 24), p=[0.3, 0.3, 0.2, 0.1, 0.1]))
    target = (float(random.uniform(0, 12)), float(random.uniform(0, 10)))
    lattice = OptimisticLattice(SPACING, target)
    scanned: set[tuple[float, float]] = set()
    closed: set[tuple[float, float]] = set()
    for step in range(5):
        viewpoint = (1.0 + SPACING * int(random.integers(0, 5)), 1.0 + SPACING * int(random.integers(0, 4)))
        look = bool(random.random() < 0.5)
        if look:
            scanned.add(viewpoint)
        shape = lattice.shape
        node = lattice.update(belief, viewpoint, scanned=look)
        assert lattice.position(node) == pytest.approx(viewpoint)
        assert lattice.grown is not None or lattice.shape == shape
        numbers = {lattice.position(k): k for k in range(lattice.shape[0] * lattice.shape[1])}
        expected = expected_edges(lattice, {numbers[p] for p in scanned}, {numbers[p] for p in closed})
        assert np.array_equal(lattice.edges, expected)
        for position, k in numbers.items():
            gap = float(np.hypot(position[0] - target[0], position[1] - target[1])) / SPACING
            assert lattice.heuristic[k] <= gap * UNITS
            free = lattice.grid.free if position in scanned else lattice.grid.possibly_free
            if gap > 5**0.5 + 1e-6 or position in closed or not free(position, target):
                assert lattice.goal_units[k] == NO_WAY
            else:
                assert lattice.goal_units[k] == pytest.approx(gap * UNITS, abs=2)
        part = random.choice(CHOICES, (int(random.integers(1, 8)), int(random.integers(1, 8))))
        # Sometimes beyond the belief, so that it grows.
        low = -4 if step == 2 else 0
        belief.assign(part, (0.5 * int(random.integers(low, 16)), 0.5 * int(random.integers(low, 12))))
        if random.random() < 0.3:
            closed.add(viewpoint)
            lattice.close(viewpoint)
