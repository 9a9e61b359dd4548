"""Whether the figures of an update are finite, and which rows of its batch are the cause when they are not."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray


def not_finite(figures: dict[str, float]) -> list[str]:
    """Return the names of the figures that are not finite."""
    return [name for name, value in figures.items() if not math.isfinite(value)]


def rows_not_finite(count: int, is_finite: Callable[[NDArray[np.bool_]], bool]) -> NDArray[np.int64]:
    """Find by halving the rows of a batch that are not finite by themselves.

    Args:
        count: rows of the batch.
        is_finite: tells whether an update with some rows alone, bool, shape (count,), has finite figures.

    Returns:
        Row numbers, ascending; none when most rows are not finite.
    """
    most = max(count // 2, 1)
    found: list[int] = []
    waiting = np.array_split(np.arange(count), 2) if count > 1 else [np.arange(1)]
    while waiting and len(found) <= most:
        rows = waiting.pop()
        chosen = np.zeros(count, dtype=np.bool_)
        chosen[rows] = True
        if is_finite(chosen):
            continue
        if len(rows) > 1:
            waiting += np.array_split(rows, 2)
        else:
            found.append(int(rows[0]))
    return np.array(sorted(found) if len(found) <= most else [], dtype=np.int64)
