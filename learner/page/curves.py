"""Curves for a page: points over updates, so many of them however long a run is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from common.page.hub import Hub

MAX_POINTS: Final = 1_000
"""Points of a curve; beyond twice as many every second one goes."""
TAGS: Final = "curve-tags"
POINTS: Final = "curve-points"
_MAX_TAGS: Final = 100


@dataclass(frozen=True, slots=True)
class Point:
    """Figures at one moment of a run.

    Attributes:
        time: Unix seconds.
        updates: of the run.
        values: by tag, as docs/metrics.md names them.
    """

    time: float
    updates: int
    values: Mapping[str, float]


class CurveChannels:
    """Puts points into a hub as two channels: the tags, and rows of time, updates and one value for each tag.

    Tags are appended as they appear, so a row is as long as there were tags when it was put.
    """

    def __init__(self) -> None:
        """Begin without points."""
        self._points: list[Point] = []
        self._tags: dict[str, int] = {}
        self._gap = 1
        self._lines: set[str] = set()

    def load(self, hub: Hub, points: Iterable[Point]) -> None:
        """Begin with the points of the time before the page."""
        every = list(points)
        step = -(-len(every) // MAX_POINTS) or 1
        # The newest stays, and evaluations are too rare to be left out.
        self._points = [each for i, each in enumerate(reversed(every)) if i % step == 0 or _is_evaluation(each)][::-1]
        self._gap = max((every[-1].updates - every[0].updates) // MAX_POINTS, 1) if every else 1
        self._put_all(hub)

    def add(self, hub: Hub, point: Point) -> None:
        """Add a point, unless the one before is too near for a curve of this length."""
        if self._points:
            since = point.updates - self._points[-1].updates
            if since < 0:
                # The learner was resumed from a checkpoint: what lies beyond is made again.
                self._points = [each for each in self._points if each.updates < point.updates]
                self._put_all(hub)
            elif since < self._gap and not _is_evaluation(point):
                return
        self._points.append(point)
        if len(self._points) > 2 * MAX_POINTS:
            self._points = [each for i, each in enumerate(self._points) if i % 2 == 0 or _is_evaluation(each)]
            self._gap *= 2
            self._put_all(hub)
        else:
            self._put(hub, point)

    def _put_all(self, hub: Hub) -> None:
        hub.clear(POINTS)
        for point in self._points:
            self._put(hub, point)

    def _put(self, hub: Hub, point: Point) -> None:
        new = [tag for tag in point.values if tag not in self._tags][: _MAX_TAGS - len(self._tags)]
        if new:
            self._tags |= {tag: len(self._tags) + i for i, tag in enumerate(new)}
            hub.put(TAGS, list(self._tags))
        row = [_short(point.values[tag]) if tag in point.values else None for tag in self._tags]
        hub.append(POINTS, [round(point.time, 1), point.updates, *row])


def _is_evaluation(point: Point) -> bool:
    return any(tag.startswith("evaluation/") for tag in point.values)


def _short(value: float) -> float | None:
    """Return a value with five digits, which no screen shows more of; None for what is not finite."""
    return float(f"{value:.5g}") if abs(value) < float("inf") else None
