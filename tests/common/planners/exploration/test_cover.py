from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from common.planners.exploration.cover import sample_cover, subspace_stops


@given(st.integers(0, 10**6), st.integers(0, 12), st.integers(0, 30), st.integers(1, 5), st.booleans())
def test_cover_leaves_nothing_that_would_add_enough(
    seed: int, rows: int, columns: int, min_gain: int, by_chance: bool
) -> None:
    random = np.random.default_rng(seed)
    seen = random.random((rows, columns)) < 0.3
    cover = sample_cover(seen, random if by_chance else None, min_gain=min_gain, choices=3)
    left = ~seen[cover].any(axis=0)
    assert all((seen[row] & left).sum() < min_gain for row in range(rows))
    covered = np.zeros(columns, dtype=np.bool_)
    for row in cover:
        assert (seen[row] & ~covered).sum() >= min_gain
        covered |= seen[row]


def test_best_first_without_chance() -> None:
    seen = np.array([[1, 1, 0, 0, 0], [0, 1, 1, 1, 0], [0, 0, 0, 1, 1]], dtype=np.bool_)
    assert sample_cover(seen, None, min_gain=1) == [1, 0, 2]
    assert sample_cover(seen, None, min_gain=2) == [1]


def test_subspaces_are_represented_by_what_sees_most() -> None:
    seen = np.array([[1, 0, 0, 0], [1, 1, 0, 0], [0, 0, 1, 1], [0, 1, 0, 0]], dtype=np.bool_)
    places = np.array([[1.0, 1.0], [2.0, 2.0], [-3.0, 1.0], [25.0, 1.0]])
    assert subspace_stops(seen, places, 10.0, 1) == [1, 2]
    assert subspace_stops(seen, places, 10.0, 3) == []
    assert subspace_stops(np.zeros((0, 4), dtype=np.bool_), np.empty((0, 2)), 10.0, 1) == []


def test_small_gains_do_not_add_up_to_a_subspace() -> None:
    # On the spot no viewpoint of the first subspace would be chosen, so it must not be worth the way there.
    seen = np.array([[1, 1, 0, 0, 0, 0, 0], [0, 0, 1, 1, 0, 0, 0], [0, 0, 0, 0, 1, 1, 1]], dtype=np.bool_)
    places = np.array([[1.0, 1.0], [2.0, 2.0], [25.0, 1.0]])
    assert subspace_stops(seen, places, 10.0, 3) == [2]
    assert subspace_stops(seen, places, 10.0, 2) == [0, 2]
