"""The path that is followed: where the robot is on it, and the point ahead that it steers for."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot

import numpy as np
from numpy.typing import NDArray

Position = tuple[float, float]


class PathTracker:
    """Remembers how far along a path the robot has come, so that a path that crosses itself or returns is no riddle."""

    _SEARCH = 2.0

    def __init__(self, path: Sequence[Position]) -> None:
        """Take a path of at least one position, metres."""
        self.path = tuple(path)
        points = np.array(self.path, dtype=np.float64).reshape(-1, 2)
        lengths = np.hypot(*np.diff(points, axis=0).T) if len(points) > 1 else np.empty(0)
        self._points: NDArray[np.float64] = points
        self._marks: NDArray[np.float64] = np.concatenate(([0.0], np.cumsum(lengths)))
        self._along: float | None = None

    @property
    def goal(self) -> Position:
        """Its last position."""
        return self.path[-1]

    @property
    def length(self) -> float:
        """Metres."""
        return float(self._marks[-1])

    def advance(self, x: float, y: float) -> tuple[float, float]:
        """Find the robot on the path.

        The first time the whole path counts, and the earlier of two equally near places; later only places around
        the last one.

        Returns:
            Metres along the path, and beside it.
        """
        first = self._along is None
        low, high = (0.0, self.length) if first else (self._along - 0.3, self._along + self._SEARCH)  # type: ignore[operator]
        best, best_along = np.inf, 0.0
        for along, distance in self._nearest(x, y, low, high):
            if distance < best - (0.05 if first else 1e-9):
                best, best_along = distance, along
        self._along = best_along
        return best_along, float(best)

    def ahead(self, x: float, y: float, distances: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return positions so many metres ahead of a robot at (x, y): straight to the path first, then along it.

        Call `advance` before.

        Returns:
            Array (n, 2), metres.
        """
        along = self._along or 0.0
        foot = np.array(self.point(along))
        robot = np.array((x, y))
        aside = float(np.hypot(*(foot - robot)))
        marks = np.clip(along + distances - aside, along, self.length)
        places = np.column_stack([np.interp(marks, self._marks, self._points[:, axis]) for axis in (0, 1)])
        before = distances < aside
        if before.any():
            places[before] = robot + (distances[before] / aside)[:, None] * (foot - robot)
        return places

    def point(self, along: float) -> Position:
        """Return the position so many metres along."""
        along = min(max(along, 0.0), self.length)
        return (
            float(np.interp(along, self._marks, self._points[:, 0])),
            float(np.interp(along, self._marks, self._points[:, 1])),
        )

    def _nearest(self, x: float, y: float, low: float, high: float) -> list[tuple[float, float]]:
        """Return (metres along, distance) of the nearest place on each segment between two marks."""
        low, high = max(low, 0.0), min(high, self.length)
        if len(self._points) == 1:
            return [(0.0, hypot(x - self._points[0, 0], y - self._points[0, 1]))]
        places = []
        for index in range(len(self._points) - 1):
            start, end = self._marks[index], self._marks[index + 1]
            if end < low or start > high:
                continue
            (ax, ay), (bx, by) = self._points[index], self._points[index + 1]
            length = end - start
            part = 0.0
            if length > 0.0:
                part = ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / length
            along = min(max(start + part, start, low), end, high)
            px, py = self.point(along)
            places.append((float(along), hypot(x - px, y - py)))
        return places
