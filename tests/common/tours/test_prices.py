import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from common.tours import cover
from common.tours.local_search import tour_length
from common.tours.prices import price_choices
from tests.common.tours.planes import uncovered, universe


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(0, 40))
def test_every_priced_choice_still_covers(seed, tolerance):
    _, points, sight, distances, missing = universe(seed)
    allowed = np.ones(len(points), dtype=np.bool_)
    gains = cover.count_gains(sight.pointer, sight.tile, sight.mask, missing, allowed)
    none = np.zeros(0, dtype=np.int64)
    arguments = (sight.pointer, sight.tile, sight.mask, missing, allowed, distances)
    stops = cover.plan_cover(*arguments, 0, gains, np.ones(len(gains)), none, tolerance, 4)
    choices = np.array([1, 2, -1, 5, int(stops[0])], dtype=np.int64)
    orders = np.zeros((5, len(stops)), dtype=np.int64)
    sizes = np.zeros(5, dtype=np.int64)
    lengths = price_choices(*arguments, stops, choices, tolerance, orders, sizes)
    assert np.isinf(lengths[2])
    for c in (0, 1, 3, 4):
        route = orders[c, : sizes[c]]
        assert uncovered(sight, missing, [choices[c], *route]) <= tolerance
        assert lengths[c] == np.float32(0) or np.isclose(
            lengths[c], tour_length(distances, choices[c], route), atol=1e-3
        )
    assert stops[0] not in orders[4, : sizes[4]]
