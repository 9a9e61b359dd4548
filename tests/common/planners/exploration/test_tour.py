from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("ortools")

from common.planners.exploration.tour import open_tour, tour_length


def _plane(count: int, seed: int) -> NDArray[np.float64]:
    points = np.random.default_rng(seed).random((count, 2)) * 50.0
    return np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))


@pytest.mark.parametrize("count", [1, 2, 3, 4, 6, 7])
@pytest.mark.parametrize("fixed_end", [False, True])
def test_small_tours_are_shortest(count: int, fixed_end: bool) -> None:
    for seed in range(4):
        distances = _plane(count, seed)
        end = count - 1 if fixed_end and count > 1 else None
        order = open_tour(distances, end)
        assert order[0] == 0
        assert sorted(order) == list(range(count))
        assert end is None or order[-1] == end
        best = min(
            tour_length(distances, [0, *rest])
            for rest in permutations(range(1, count))
            if end is None or rest[-1] == end
        )
        # Local search on seven stops may miss the optimum by a little.
        assert tour_length(distances, order) <= 1.05 * best + 0.1


def test_equal_distances_give_equal_tours() -> None:
    distances = _plane(25, 1)
    assert open_tour(distances) == open_tour(distances)


def test_stop_without_a_way_is_an_error() -> None:
    distances = _plane(5, 0)
    distances[3, :] = distances[:, 3] = np.inf
    with pytest.raises(ValueError, match="cannot be reached"):
        open_tour(distances)
