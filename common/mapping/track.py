"""Where a robot has been: the one proof of a passage that its map shows too narrow."""

from __future__ import annotations

from math import hypot
from typing import Final

import numpy as np
from numpy.typing import NDArray

_FIRST_CAPACITY: Final = 256


class Track:
    """Places that the robot has been to, metres, the newest last; it only grows.

    Attributes:
        step: places nearer to the one before are left out, metres, so that a robot that stands costs nothing.
    """

    def __init__(self, step: float) -> None:
        """Begin with no place."""
        self.step = step
        self._places = np.empty((_FIRST_CAPACITY, 2))
        self._count = 0

    @property
    def places(self) -> NDArray[np.float64]:
        """(x, y) of all places, oldest first, metres, shape (n, 2); a view."""
        return self._places[: self._count]

    def add(self, position: tuple[float, float]) -> None:
        """Note a place, metres."""
        count = self._count
        if count:
            x, y = self._places[count - 1]
            if hypot(position[0] - x, position[1] - y) < self.step:
                return
        if count == len(self._places):
            self._places = np.concatenate([self._places, np.empty_like(self._places)])
        self._places[count] = position
        self._count = count + 1

    def back(self, newest: int, oldest: int) -> list[tuple[float, float]]:
        """Return the way from one place back to an older one, both included, metres.

        Places within half a step of a straight line between two that stay are left out.
        """
        way = self.places[oldest : newest + 1][::-1]
        corners = [0]
        while corners[-1] < len(way) - 1:
            end = corners[-1] + 1
            while end + 1 < len(way) and _off_line(way[corners[-1] : end + 2]) <= self.step / 2.0:
                end += 1
            corners.append(end)
        return [(float(x), float(y)) for x, y in way[corners]]


def _off_line(way: NDArray[np.float64]) -> float:
    """Return how far the places of a way are from the straight segment between its ends at most, metres."""
    start, along = way[0], way[-1] - way[0]
    length = float(along @ along)
    share = np.clip((way - start) @ along / length, 0.0, 1.0) if length > 0.0 else np.zeros(len(way))
    return float(np.hypot(*(way - start - share[:, None] * along).T).max())
