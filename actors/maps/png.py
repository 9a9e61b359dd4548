"""PNG files of the public format: gray 195 is free, gray 127 is not, a yellow start and a red target."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from actors.maps.grid_map import GridMap
from actors.maps.layout import BLOCK
from common.errors import MapError
from common.system.extras import optional

_OCCUPIED = (127, 127, 127)
_FREE = (195, 195, 195)
_START = (255, 217, 0)
_TARGET = (238, 22, 31)


def write_png(world: GridMap, path: Path) -> None:
    """Write a map in the public PNG format, so that it can be stored and shared.

    Reading it back by `load_image` with the same scale gives the same free space, start, target and marker, when start
    and target lie on corners of cells, as those of the generators do (else they move by up to half a cell).

    Args:
        world: the map; its origin and resolution are not part of the format.
        path: the file; its folder must exist.

    Raises:
        MapError: the file cannot be written.
        MissingPackageError: Pillow is not installed.
    """
    with optional("an image file", "actor"):
        from PIL import Image

    rows, columns = world.free.shape
    image = np.zeros((rows, columns), dtype=np.uint8)
    image[world.free] = 1
    image[_square(world, world.start)] = 2
    if world.target is not None:
        region = world.target_region
        image[_square(world, world.target) if region is None else region & world.free] = 3
    picture = Image.fromarray(np.ascontiguousarray(image[::-1]), mode=None)
    picture.putpalette([value for colour in (_OCCUPIED, _FREE, _START, _TARGET) for value in colour])
    try:
        picture.save(path, format="PNG", optimize=True)
    except OSError as error:
        raise MapError(
            f"{path}: cannot write the map ({error.strerror or error}): check that the folder exists and is writable"
        ) from error


def _square(world: GridMap, position: tuple[float, float]) -> NDArray[np.bool_]:
    """Return the largest square of free cells around a position, at most one block wide."""
    column = round((position[0] - world.origin[0]) / world.resolution)
    row = round((position[1] - world.origin[1]) / world.resolution)
    rows, columns = world.free.shape
    half = min(BLOCK // 2, row, column, rows - row, columns - column)
    while half > 1 and not world.free[row - half : row + half, column - half : column + half].all():
        half -= 1
    square = np.zeros(world.free.shape, dtype=np.bool_)
    square[row - half : row + half, column - half : column + half] = True
    return square & world.free
