from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from common.mapping.belief import Belief
from common.mapping.sight import FREE, NOTHING_LOST, OCCUPIED, OUTSIDE, UNKNOWN
from common.planners.navigation.optimistic import OptimisticBelief

CHOICES = np.array([UNKNOWN, FREE, OCCUPIED], dtype=np.int8)


def belief_of(cells: np.ndarray, origin: tuple[float, float] = (0.0, 0.0)) -> Belief:
    belief = Belief(0.5, 5.0)
    belief.assign(cells, origin)
    return belief


def at(world: OptimisticBelief, x: float, y: float) -> int:
    return int(world.padded[world.cell((x, y))])


def test_unknown_cells_may_be_free_and_occupied_ones_may_not() -> None:
    cells = np.full((8, 8), UNKNOWN, dtype=np.int8)
    cells[4, 4] = OCCUPIED
    world = OptimisticBelief(2.0)
    world.update(belief_of(cells))
    assert at(world, 2.1, 2.1) == OCCUPIED
    assert at(world, 1.9, 2.1) == FREE
    # Beyond the belief, too.
    assert at(world, -1.9, 5.9) == FREE
    assert world.shape == (16, 16)
    assert world.origin == (-2.0, -2.0)
    assert (world.padded == FREE).sum() == 16 * 16 - 1


def test_changes_are_told() -> None:
    belief = belief_of(np.full((8, 8), UNKNOWN, dtype=np.int8))
    world = OptimisticBelief(1.0)
    world.update(belief)
    assert (world.generation, world.box, world.lost) == (1, (1, 12, 1, 12), NOTHING_LOST)
    world.update(belief)
    assert (world.generation, world.box, len(world.changed)) == (1, None, 0)
    belief.assign(np.full((1, 2), OCCUPIED, dtype=np.int8), (1.0, 1.5))
    world.update(belief)
    assert (world.box, world.lost) == ((6, 6, 5, 6), (6, 6, 5, 6))
    assert sorted(world.changed.tolist()) == [6 * 14 + 5, 6 * 14 + 6]
    # What was unknown and becomes free is as hoped.
    belief.assign(np.full((1, 2), FREE, dtype=np.int8), (1.0, 2.5))
    world.update(belief)
    assert world.box is None
    belief.assign(np.full((1, 1), FREE, dtype=np.int8), (1.0, 1.5))
    world.update(belief)
    assert (world.box, world.lost) == ((6, 6, 5, 5), NOTHING_LOST)


def test_a_belief_that_grows_moves_the_grid() -> None:
    belief = belief_of(np.full((4, 4), FREE, dtype=np.int8))
    world = OptimisticBelief(1.0)
    world.update(belief, (5.0, 1.0))
    assert world.shape == (8, 15)
    belief.assign(np.full((4, 4), OCCUPIED, dtype=np.int8), (-2.0, -2.0))
    world.update(belief, (5.0, 1.0))
    assert world.generation == 2
    assert world.origin == (-3.0, -3.0)
    assert at(world, -1.0, -1.0) == OCCUPIED
    assert at(world, 0.5, 0.5) == FREE
    assert world.lost[1] >= 0


def test_a_doubtful_cell_counts_as_occupied_until_it_is_known_to_be_free() -> None:
    belief = belief_of(np.full((8, 8), UNKNOWN, dtype=np.int8))
    world = OptimisticBelief(1.0)
    world.update(belief)
    world.doubt((2.1, 2.1))
    world.doubt((3.1, 3.1), always=True)
    world.doubt((-0.4, 0.1))
    assert at(world, 2.1, 2.1) == FREE
    world.update(belief)
    assert world.box == (3, 9, 2, 9)
    assert [at(world, *place) for place in ((2.1, 2.1), (3.1, 3.1), (-0.4, 0.1))] == [OCCUPIED] * 3
    belief.assign(np.full((8, 8), FREE, dtype=np.int8), (0.0, 0.0))
    world.update(belief)
    assert [at(world, *place) for place in ((2.1, 2.1), (3.1, 3.1), (-0.4, 0.1))] == [FREE, OCCUPIED, OCCUPIED]
    # Doubts outlive a growth.
    belief.assign(np.full((4, 4), UNKNOWN, dtype=np.int8), (-2.0, -2.0))
    world.update(belief)
    assert [at(world, *place) for place in ((2.1, 2.1), (3.1, 3.1), (-0.4, 0.1))] == [FREE, OCCUPIED, OCCUPIED]


@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), steps=st.integers(1, 6))
def test_an_update_gives_what_the_belief_says_and_tells_every_change(seed: int, steps: int) -> None:
    random = np.random.default_rng(seed)
    belief = belief_of(random.choice(CHOICES, (12, 14)))
    world = OptimisticBelief(1.5)
    soft: set[tuple[int, int]] = set()
    before = np.zeros((0, 0), dtype=np.int8)
    for _ in range(steps):
        generation = world.generation
        world.update(belief)
        down, right = (a - b for a, b in zip(belief.first_cell, world.first_cell, strict=True))
        expected = np.full(world.padded.shape, OUTSIDE, dtype=np.int8)
        expected[1:-1, 1:-1] = FREE
        rows, columns = belief.shape
        inside = expected[down + 1 : down + 1 + rows, right + 1 : right + 1 + columns]
        inside[belief.cells == OCCUPIED] = OCCUPIED
        for row, column in soft:
            r, c = row - belief.first_cell[0], column - belief.first_cell[1]
            if belief.cells[r, c] != FREE:
                inside[r, c] = OCCUPIED
        assert np.array_equal(world.padded, expected)
        if world.generation == generation:
            different = np.flatnonzero(world.padded != before)
            assert sorted(world.changed.tolist()) == different.tolist()
            lost = [cell for cell in different if expected.reshape(-1)[cell] == OCCUPIED]
            assert (world.lost[1] >= 0) == bool(lost)
        before = world.padded.copy()
        # Sometimes beyond the belief, so that it grows.
        low = -3 if random.random() < 0.3 else 0
        part = random.choice(CHOICES, tuple(random.integers(1, 8, 2)))
        belief.assign(part, (0.5 * int(random.integers(low, 12)), 0.5 * int(random.integers(low, 10))))
        row, column = (int(random.integers(size)) for size in belief.shape)
        world.update(belief)
        before = world.padded.copy() if world.generation != generation else before
        step = belief.resolution
        world.doubt((belief.origin[0] + (column + 0.5) * step, belief.origin[1] + (row + 0.5) * step))
        soft.add((row + belief.first_cell[0], column + belief.first_cell[1]))
        before = world.padded.copy()
