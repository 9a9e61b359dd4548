from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from common.tours import cover
from common.tours.local_search import tour_length
from tests.common.tours.planes import uncovered, universe


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(0, 40))
def test_a_planned_tour_covers_to_the_tolerance_and_improving_never_lengthens(seed, tolerance):
    _, points, sight, distances, missing = universe(seed)
    allowed = np.ones(len(points), dtype=np.bool_)
    allowed[0] = False
    gains = cover.count_gains(sight.pointer, sight.tile, sight.mask, missing, allowed)
    attainable = uncovered(sight, missing, np.flatnonzero(allowed))
    arguments = (sight.pointer, sight.tile, sight.mask, missing, allowed, distances, 0)
    none = np.zeros(0, dtype=np.int64)
    rough = cover.plan_cover(*arguments, gains.copy(), np.ones(len(gains)), none, tolerance, 0)
    fine = cover.plan_cover(*arguments, gains.copy(), np.ones(len(gains)), none, tolerance, 6)
    for stops in (rough, fine):
        assert 0 not in stops
        assert uncovered(sight, missing, stops) <= max(tolerance, attainable)
    assert tour_length(distances, 0, fine) <= tour_length(distances, 0, rough) + 1e-2


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 8.0))
def test_what_is_taken_along_costs_no_more_than_its_detour(seed, detour):
    _, points, sight, distances, everything = universe(seed)
    rows = (sight.pointer, sight.tile, sight.mask)
    allowed = np.random.default_rng(seed).random(len(points)) < 0.8
    stops = np.array([3, 7, 1], dtype=np.int64)
    extra = everything.copy()
    tour = cover.take_along(*rows, extra, allowed, distances, 0, stops, detour)
    added = [stop for stop in tour.tolist() if stop not in stops]
    assert [stop for stop in tour.tolist() if stop in stops] == stops.tolist()
    assert allowed[added].all()
    assert len(set(tour.tolist())) == len(tour)
    longer = tour_length(distances, 0, tour) - tour_length(distances, 0, stops)
    assert longer <= len(added) * detour + 1e-3
    # What is left of the extra is just what the tour does not see, and nothing of it is on the way any more.
    assert uncovered(sight, extra, []) == uncovered(sight, everything, tour)
    assert uncovered(sight, extra, tour) == uncovered(sight, extra, [])
    for new in np.flatnonzero(allowed).tolist():
        if uncovered(sight, extra, [new]) < uncovered(sight, extra, []):
            legs = [0, *tour.tolist()]
            detours = [distances[a, new] + distances[new, b] - distances[a, b] for a, b in pairwise(legs)]
            assert min(detours) > detour - 1e-3
