"""Positions in pixels of a map's image: x right, y down, from the centre of the top-left pixel."""

from __future__ import annotations

from actors.maps.grid_map import GridMap

Position = tuple[float, float]


def to_pixels(world: GridMap, position: Position) -> Position:
    """Return a position in metres (map frame, y up) in pixels of the image."""
    rows = world.free.shape[0]
    return (
        (position[0] - world.origin[0]) / world.resolution - 0.5,
        rows - 0.5 - (position[1] - world.origin[1]) / world.resolution,
    )


def to_metres(world: GridMap, pixel: Position) -> Position:
    """Return a position in pixels of the image in metres (map frame, y up)."""
    rows = world.free.shape[0]
    return (
        world.origin[0] + (pixel[0] + 0.5) * world.resolution,
        world.origin[1] + (rows - 0.5 - pixel[1]) * world.resolution,
    )
