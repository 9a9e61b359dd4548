"""Puts a start and a target that were given in metres onto free space, or says where else they could be."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.maps.connectivity import reachable
from actors.maps.grid_map import GridMap
from actors.maps.layout import lattice_origin
from common.errors import MapError

Position = tuple[float, float]

SMALLEST_ROOM: Final = 0.25
"""Square metres: who can reach no more than this from the start stands in a speck of the image and in no room."""
MAX_COORDINATE: Final = 1e8
"""Metres from the origin of a map's frame, beyond which no place of a map lies: UTM coordinates are less."""
MAX_SCALE: Final = 1e6
"""Metres per pixel, as in the settings."""


def place(
    path: Path,
    name: str,
    free: NDArray[np.bool_],
    resolution: float,
    origin: Position,
    start: Position,
    target: Position | None,
    start_marker: NDArray[np.bool_] | None = None,
) -> GridMap:
    """Assemble a map whose start, and target if any, are given as positions.

    Args:
        path: the file, for messages.
        name: of the map.
        free: bool, shape (rows, columns), row 0 at the bottom.
        resolution: metres per cell.
        origin: (x, y) of the lower left corner, metres.
        start: (x, y), metres, in the same frame.
        target: likewise, or None.
        start_marker: bool, shape of ``free``: what is painted as the start, which must have a way out.

    Returns:
        The map; its target has no marker, so the robot has arrived when it is close enough.

    Raises:
        MapError: nothing is free, or a position is outside, not free, or cut off.
    """
    # Written so that NaN is not within.
    if not 0.0 < resolution <= MAX_SCALE:
        raise MapError(
            f"{path}: expected metres per pixel above 0 and up to {MAX_SCALE:g}, got {resolution:g}: correct it"
        )
    for what, position in (("start", start), ("target", target)):
        if position is not None and not all(math.isfinite(coordinate) for coordinate in position):
            raise MapError(f"{path}: expected the {what} (x, y) in metres, got {_shown(position)}: correct it")
    x, y = lattice_origin(free.shape[0], resolution)
    world = GridMap(
        name=name,
        free=free,
        resolution=resolution,
        origin=origin,
        start=start,
        target=target,
        target_region=None,
        lattice_origin=(origin[0] + x, origin[1] + y),
    )
    if not free.any():
        raise MapError(f"{path}: expected free space, every pixel is occupied or unknown: see docs/maps.md for what is")
    _check_free(path, world, "start", start)
    region = reachable(free, world.cell(start))
    if start_marker is not None and not (region & ~start_marker).any():
        raise MapError(f"{path}: the start is enclosed, no free space joins it: open a way out of the start marker")
    area = float(np.count_nonzero(region)) * resolution**2
    if area < SMALLEST_ROOM:
        raise MapError(
            f"{path}: only {area:.2f} m2 can be reached from the start {_shown(start)}: choose a start in a room"
        )
    if target is not None:
        _check_free(path, world, "target", target)
        if not region[world.cell(target)]:
            raise MapError(
                f"{path}: no free way leads from start to target, from {_shown(start)} to {_shown(target)}: open one, "
                "or move one of the two"
            )
    return world


def _check_free(path: Path, world: GridMap, what: str, position: Position) -> None:
    if world.is_free(position):
        return
    (left, bottom), (width, height) = world.origin, world.size
    rows, columns = np.nonzero(world.free)
    x = left + (columns + 0.5) * world.resolution
    y = bottom + (rows + 0.5) * world.resolution
    nearest = int(np.argmin(np.hypot(x - position[0], y - position[1])))
    inside = left <= position[0] < left + width and bottom <= position[1] < bottom + height
    corner = _shown((left + width, bottom + height))
    where = "is occupied or unknown" if inside else f"is outside the map ({_shown(world.origin)} to {corner})"
    raise MapError(
        f"{path}: expected a free place, the {what} {_shown(position)} {where}: choose another one in metres; the "
        f"nearest is {_shown((float(x[nearest]), float(y[nearest])))}"
    )


def _shown(position: Position) -> str:
    return f"({position[0]:.2f}, {position[1]:.2f})"
