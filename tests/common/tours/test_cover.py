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
