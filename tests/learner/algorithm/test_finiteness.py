from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from learner.algorithm.finiteness import not_finite, rows_not_finite


def test_figures_are_named_that_are_not_finite() -> None:
    assert not_finite({"a": 0.0, "b": float("nan"), "c": -1e300, "d": float("-inf")}) == ["b", "d"]


@pytest.mark.parametrize(
    ("count", "bad", "found"),
    [
        (9, [], []),
        (9, [4], [4]),
        (9, [0, 1, 8], [0, 1, 8]),
        (9, [0, 2, 4, 6, 8], []),
        (1, [0], [0]),
    ],
)
def test_rows_are_found_unless_most_are_bad(count: int, bad: list[int], found: list[int]) -> None:
    def is_finite(chosen: NDArray[np.bool_]) -> bool:
        return not chosen[bad].any()

    assert rows_not_finite(count, is_finite).tolist() == found
