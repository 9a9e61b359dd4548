"""The polygon that the robot must not leave."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from shapely import LineString, Polygon, is_valid_reason, prepare
from shapely import Point as ShapelyPoint

from common.errors import ConfigError
from deploy.config import Point


class Geofence:
    """A polygon in the map frame, or no fence at all when it has no corners.

    Its edge belongs to it.
    """

    def __init__(self, corners: Sequence[Point], margin: float = 0.0) -> None:
        """Take the polygon, shrunk by a margin (such as the robot's radius).

        Args:
            corners: (x, y) in the map frame, metres; empty for no fence.
            margin: metres to keep from the edge.

        Raises:
            ConfigError: the corners make no polygon, or the margin leaves nothing of it.
        """
        self._polygon: Polygon | None = None
        if not corners:
            return
        polygon = Polygon(corners) if len(corners) >= 3 else None
        if polygon is None or not polygon.is_valid or polygon.area <= 0.0:
            why = "it has fewer than 3 corners" if polygon is None else is_valid_reason(polygon)
            raise ConfigError(
                f"geofence must be a polygon whose sides do not cross, got {list(corners)} ({why}): "
                "list its corners in order"
            )
        inner = polygon.buffer(-margin) if margin else polygon
        if inner.is_empty:
            raise ConfigError(f"geofence leaves no room inside a margin of {margin:g} m: make it larger")
        prepare(inner)
        self._polygon = inner

    @property
    def exists(self) -> bool:
        """Whether there is a fence."""
        return self._polygon is not None

    def contains(self, position: Point) -> bool:
        """Whether a position (x, y) lies inside."""
        return self._polygon is None or bool(self._polygon.covers(ShapelyPoint(position)))

    def allows(self, start: Point, end: Point) -> bool:
        """Whether the straight line between two positions lies inside."""
        if self._polygon is None:
            return True
        return bool(self._polygon.covers(LineString([start, end]) if start != end else ShapelyPoint(start)))

    def clip(self, path: Sequence[Point]) -> list[Point]:
        """Cut a path off before the first of its points that cannot be reached inside; empty if none can.

        The first point itself, where the robot stands, may lie outside: then only the way straight back in is kept.
        """
        if self._polygon is None or not path:
            return list(path)
        kept = [path[0]] if self.contains(path[0]) else []
        for start, end in pairwise(path):
            returns = not kept and self.contains(end)
            if not (returns or (kept and self.allows(start, end))):
                break
            kept = [start, end] if returns else [*kept, end]
        return kept
