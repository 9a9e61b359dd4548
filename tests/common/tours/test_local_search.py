import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from common.tours.local_search import improve_tour, insert_cheapest, tour_length


def random_distances(seed, n):
    points = np.random.default_rng(seed).uniform(0, 100, (n, 2))
    return np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1)).astype(np.float32)


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_improving_keeps_the_stops_and_never_lengthens(seed, n):
    distances = random_distances(seed, n + 1)
    stops = np.random.default_rng(seed).permutation(n).astype(np.int64) + 1
    before = tour_length(distances, 0, stops)
    improve_tour(distances, 0, stops)
    assert sorted(stops) == list(range(1, n + 1))
    assert tour_length(distances, 0, stops) <= before + 1e-3


def test_small_tours_are_nearly_always_optimal():
    optimal = 0
    for seed in range(60):
        distances = random_distances(seed, 7)
        stops = np.zeros(6, dtype=np.int64)
        for size in range(6):
            insert_cheapest(distances, 0, stops, size, size + 1)
        improve_tour(distances, 0, stops)
        best = min(tour_length(distances, 0, np.array(order)) for order in itertools.permutations(range(1, 7)))
        length = tour_length(distances, 0, stops)
        assert length <= 1.15 * best + 1e-3
        optimal += length <= best + 1e-2
    assert optimal >= 50


def test_an_empty_tour_has_no_length():
    distances = random_distances(0, 3)
    stops = np.zeros(0, dtype=np.int64)
    improve_tour(distances, 0, stops)
    assert tour_length(distances, 0, stops) == 0.0
