"""The polygon that a robot must not leave, as shapes of shapely, which takes a moment to import."""

from __future__ import annotations

from collections.abc import Sequence

from shapely import Point, Polygon, is_valid_reason


def fence_shapes(corners: Sequence[tuple[float, float]], margin: float) -> tuple[Polygon, Polygon]:
    """Return a polygon, and what is left of it within a margin.

    Args:
        corners: (x, y) in the map frame, metres.
        margin: metres, 0 or more.

    Raises:
        ValueError: the corners make no polygon, or the margin leaves nothing of it. The message says what was expected,
            not what came.
    """
    polygon = Polygon(corners) if len(corners) >= 3 else None
    if polygon is None or not polygon.is_valid or polygon.area <= 0.0:
        why = "it has fewer than 3 corners" if polygon is None else is_valid_reason(polygon)
        raise ValueError(f"geofence must be a polygon whose sides do not cross ({why}): list its corners in order")
    inner = polygon.buffer(-margin) if margin else polygon
    if inner.is_empty:
        raise ValueError(f"geofence leaves no room inside a margin of {margin:g} m for the robot: make it larger")
    return polygon, inner


def comes_near(inner: Polygon, target: tuple[float, float], radius: float) -> bool:
    """Whether a robot whose centre stays in ``inner`` can come so near to a target, metres."""
    return float(inner.distance(Point(target))) <= radius
