"""Path lengths looked up row by row."""

from __future__ import annotations

import numpy as np

from common.planners.exploration.ways import Ways
from tests.common.planners.worlds import ROOMS, looked


def test_rows_are_the_mappers_distances_and_the_rest_is_unknown() -> None:
    x, y = ROOMS.start
    mapper, _ = looked(ROOMS, [(x, y), (x + 12.0, y + 16.0), (x + 28.0, y + 20.0)])
    nodes = np.arange(0, len(mapper.viewpoints), 2)
    assert len(nodes) > 8
    ways = Ways(mapper, nodes)
    assert np.isinf(ways.lengths).all()
    ways.look_up([1, 4, 4])
    ways.look_up([4, 5])
    for place in range(len(nodes)):
        exact = mapper.distances(int(nodes[place]))[nodes]
        if place in (1, 4, 5):
            np.testing.assert_allclose(ways.lengths[place], exact, rtol=1e-5)
        else:
            assert np.isinf(ways.lengths[place, [0, 2, 3]]).all()
    np.testing.assert_array_equal(ways.lengths, ways.lengths.T)
