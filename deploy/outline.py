"""The robot's outline: a convex polygon around its centre, in its own frame."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot

Corner = tuple[float, float]
Edge = tuple[float, float, float]
"""Normal (x, y), outwards and of length 1, and the distance of the edge's line from the centre, metres."""

# Corners on a straight line are none too many, and figures are rounded.
_SLACK = 1e-9


def edges_of(corners: Sequence[Corner]) -> list[Edge]:
    """Return the edges of an outline, in the order of its corners, counter-clockwise.

    Raises:
        ValueError: it has fewer than three corners, is not convex, or does not lie around the centre.
    """
    if len(corners) < 3:
        raise ValueError(f"a footprint needs at least 3 corners, got {len(corners)}: add corners or leave it empty")
    area = sum(a[0] * b[1] - b[0] * a[1] for a, b in _pairs(corners))
    ordered = list(corners) if area > 0.0 else list(reversed(corners))
    edges = []
    for (ax, ay), (bx, by) in _pairs(ordered):
        length = hypot(bx - ax, by - ay)
        if length <= _SLACK:
            raise ValueError(f"two corners of the footprint are the same, ({ax:g}, {ay:g}): leave one out")
        normal = (by - ay) / length, (ax - bx) / length
        offset = normal[0] * ax + normal[1] * ay
        if any(normal[0] * x + normal[1] * y > offset + _SLACK for x, y in ordered):
            raise ValueError("a footprint must be convex: give the corners of its convex hull")
        if offset <= _SLACK:
            raise ValueError("a footprint must contain (0, 0), the origin of the robot's base frame")
        edges.append((*normal, offset))
    return edges


def inscribed_radius(corners: Sequence[Corner]) -> float:
    """Return the radius of the largest circle around the centre that lies within an outline, metres."""
    return min(offset for _, _, offset in edges_of(corners))


def circumscribed_radius(corners: Sequence[Corner]) -> float:
    """Return the radius of the smallest circle around the centre that holds an outline, metres."""
    return max(hypot(*corner) for corner in corners)


def _pairs(corners: Sequence[Corner]) -> list[tuple[Corner, Corner]]:
    return list(zip(corners, [*corners[1:], corners[0]], strict=True))
