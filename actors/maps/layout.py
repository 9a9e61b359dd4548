"""The layout of the public maps: 16 px blocks, markers of one block, a lattice through the block centres."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from actors.maps.grid_map import GridMap

BLOCK = 16
"""Side of a block and of a marker, pixels: one step of the nominal viewpoint lattice (4 m at 0.25 m per pixel)."""


def lattice_origin(rows: int, metres_per_pixel: float) -> tuple[float, float]:
    """Return one point of the lattice through the block centres.

    Blocks are counted from the image's top left corner, so that with a height that is no multiple of a block the
    lattice still meets the centres of the upper blocks.

    Args:
        rows: height of the image, pixels.
        metres_per_pixel: scale of the image.

    Returns:
        (x, y), metres from the image's lower left corner, each at least 0 and less than one block.
    """
    half = BLOCK // 2
    return half * metres_per_pixel, ((rows - half) % BLOCK) * metres_per_pixel


def marker_region(shape: tuple[int, int], centre: tuple[float, float]) -> NDArray[np.bool_]:
    """Return the cells of a marker: one block around a centre, clipped to the grid.

    Args:
        shape: (rows, columns) of the grid.
        centre: (x, y) in cells from the lower left corner.

    Returns:
        bool, shape (rows, columns).
    """
    half = BLOCK // 2
    region = np.zeros(shape, dtype=np.bool_)
    row, column = round(centre[1]), round(centre[0])
    region[max(row - half, 0) : max(row + half, 0), max(column - half, 0) : max(column + half, 0)] = True
    return region


def build_map(
    name: str,
    free: NDArray[np.bool_],
    metres_per_pixel: float,
    start: tuple[float, float],
    target: tuple[float, float] | None,
) -> GridMap:
    """Assemble a map from cells; its lower left corner is the frame's origin.

    Args:
        name: name of the map.
        free: bool, shape (rows, columns), row 0 at the bottom.
        metres_per_pixel: side of a cell.
        start: (x, y) in cells from the lower left corner, in free space.
        target: likewise, or None.

    Returns:
        The map, with a marker of one block around its target.
    """
    scaled = None if target is None else (target[0] * metres_per_pixel, target[1] * metres_per_pixel)
    region = None if target is None else marker_region((free.shape[0], free.shape[1]), target) & free
    return GridMap(
        name=name,
        free=free,
        resolution=metres_per_pixel,
        origin=(0.0, 0.0),
        start=(start[0] * metres_per_pixel, start[1] * metres_per_pixel),
        target=scaled,
        target_region=region,
        lattice_origin=lattice_origin(free.shape[0], metres_per_pixel),
    )
