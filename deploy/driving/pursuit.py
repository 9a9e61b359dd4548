"""The path that is followed: where the robot is on it, and the point ahead that it steers for."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import hypot

import numpy as np
from numpy.typing import NDArray

Position = tuple[float, float]


class PathTracker:
    """Remembers how far along a path the robot has come, so that a path that crosses itself or returns is no riddle."""

    _SEARCH = 2.0
    # A path that leads less far away than this, metres, may come nearer behind the next corner.
    _AWAY = 1e-6

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

        A path is made for where the robot is. So the first time it is looked for from the path's begin on, as far as
        that comes nearer: a later part may pass near by, and taking it would leave out what lies between. Later only
        places around the last one count.

        Returns:
            Metres along the path, and beside it.
        """
        if self._along is None:
            self._along, aside = self._first(x, y)
            return self._along, aside
        best, self._along = min(self._nearest(x, y, self._along - 0.3, self._along + self._SEARCH))
        return self._along, best

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

    def _first(self, x: float, y: float) -> tuple[float, float]:
        """Return metres along and beside of the nearest place before the first from which the path leads away."""
        aside, along = hypot(x - self._points[0, 0], y - self._points[0, 1]), 0.0
        for index, (end_x, end_y) in enumerate(self._points[1:].tolist()):
            aside, along = min((aside, along), self._on_segment(index, x, y))
            if hypot(x - end_x, y - end_y) > aside + self._AWAY:
                break
        return along, aside

    def _nearest(self, x: float, y: float, low: float, high: float) -> list[tuple[float, float]]:
        """Return (distance, metres along) of the nearest place on each segment between two marks."""
        if len(self._points) == 1:
            return [(hypot(x - self._points[0, 0], y - self._points[0, 1]), 0.0)]
        low, high = max(low, 0.0), min(high, self.length)
        return [
            self._on_segment(index, x, y, low, high)
            for index, (start, end) in enumerate(pairwise(self._marks))
            if start <= high and end >= low
        ]

    def _on_segment(
        self, index: int, x: float, y: float, low: float = -np.inf, high: float = np.inf
    ) -> tuple[float, float]:
        """Return (distance, metres along) of the nearest place on a segment, as far as it lies between two marks."""
        start, end = float(self._marks[index]), float(self._marks[index + 1])
        (ax, ay), (bx, by) = self._points[index].tolist(), self._points[index + 1].tolist()
        length = end - start
        part = ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / length if length > 0.0 else 0.0
        along = min(max(start + part, start, low), end, high)
        px, py = self.point(along)
        return hypot(px - x, py - y), along
