"""Path lengths looked up row by row, and kept while the graph changes."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from common.mapping.adjacency import Adjacency
from common.planners.exploration.ways import Paths, Ways
from tests.common.planners.worlds import ROOMS, looked


def test_rows_are_the_mappers_distances_and_the_rest_is_unknown() -> None:
    x, y = ROOMS.start
    mapper, _ = looked(ROOMS, [(x, y), (x + 12.0, y + 16.0), (x + 28.0, y + 20.0)])
    nodes = np.arange(0, len(mapper.viewpoints), 2)
    assert len(nodes) > 8
    paths = Paths()
    paths.update(mapper.viewpoints, mapper.adjacency)
    ways = Ways(paths, nodes)
    assert np.isinf(ways.lengths).all()
    ways.look_up(np.array([1, 4, 4]))
    ways.look_up(np.array([4, 5]))
    for place in range(len(nodes)):
        exact = mapper.distances(int(nodes[place]))[nodes]
        if place in (1, 4, 5):
            np.testing.assert_allclose(ways.lengths[place], exact, rtol=1e-5)
        else:
            assert np.isinf(ways.lengths[place, [0, 2, 3]]).all()
    np.testing.assert_array_equal(ways.lengths, ways.lengths.T)


def _graph(random: np.random.Generator, places: NDArray[np.float64], share: float) -> Adjacency:
    """Join some of the places that lie near to each other."""
    gaps = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    joined = np.triu((gaps < 3.0) & (random.random(gaps.shape) < share), 1)
    first, second = np.nonzero(joined | joined.T)
    pointer = np.concatenate([[0], np.cumsum(np.bincount(first, minlength=len(places)))])
    return Adjacency(pointer, second.astype(np.int32), gaps[first, second], np.zeros(len(first), dtype=np.bool_))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(seed=st.integers(0, 1 << 30), share=st.sampled_from([0.3, 0.7, 1.0]), stays=st.sampled_from([0.5, 0.9, 1.0]))
def test_rows_that_are_kept_are_those_of_a_search(seed: int, share: float, stays: float) -> None:
    random = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.arange(8.0), np.arange(6.0)), axis=-1).reshape(-1, 2) * 1.5
    grid += random.uniform(-0.4, 0.4, grid.shape)
    kept = Paths()
    places = grid
    for _ in range(5):
        # Some places stay, in another order, some are new or come back; some edges come or go with them.
        there = random.random(len(places)) < stays
        again = grid[random.random(len(grid)) < 1.0 - stays]
        places = random.permutation(np.unique(np.concatenate([places[there], again, grid[:2]]), axis=0))
        edges = _graph(random, places, share)
        kept.update(places, edges)
        anew = Paths()
        anew.update(places, edges)
        nodes = random.permutation(len(places))[:12]
        found, exact = kept.look_up(nodes), anew.look_up(nodes)
        np.testing.assert_array_equal(found.rows[found.row_of[nodes]], exact.rows[exact.row_of[nodes]])
