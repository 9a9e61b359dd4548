"""The belief around the robot as two small images, for networks that read maps instead of graphs.

The images lie straight in the map frame, with the robot's viewpoint in the middle (where four pixels meet), the first
row at the bottom. They are measured by the range of the sensor or by the spacing of the viewpoints, so that the size of
the cells does not change what they show. By ranges `near` reaches 1.5 to each side and `far` 8, whatever the lattice;
by lattice steps they reach 12 and 48, so that four pixels of `near` are one lattice square.

A pixel is one byte: the share of its area that is known to be free in the upper half, that of obstacles in the lower,
both in fifteenths. The rest is unknown.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.config import ImageScale, MappingConfig
from common.mapping.cell_grid import CellGrid
from common.mapping.sight import FREE, OCCUPIED
from common.observations.observation import IMAGE_SIDE, IMAGES
from common.system.jit import njit

REACHES: Final[dict[ImageScale, tuple[float, float]]] = {"range": (1.5, 8.0), "spacing": (12.0, 48.0)}
"""How far each of `IMAGES` reaches to each side of the robot, in ranges of the sensor or in lattice steps."""
# A pixel looks at the cells in so many places along each axis.
_SAMPLES: Final = 4
_SHARES: Final = 15


def image_reaches(scale: ImageScale, mapping: MappingConfig) -> tuple[float, float]:
    """Return how far each of `IMAGES` reaches to each side, metres."""
    unit = mapping.sensor_range if scale == "range" else mapping.viewpoint_spacing
    near, far = REACHES[scale]
    return near * unit, far * unit


def occupancy_image(grid: CellGrid, position: tuple[float, float], reaches: tuple[float, float]) -> NDArray[np.uint8]:
    """Draw what is known around a position.

    Args:
        grid: the belief.
        position: (x, y) of the middle, metres.
        reaches: how far each image reaches to each side, metres.

    Returns:
        uint8, shape (2, side * side), the pixels of each image row by row.
    """
    images = np.zeros((len(IMAGES), IMAGE_SIDE**2), dtype=np.uint8)
    # In cells of the padded grid.
    x, y = ((place - first) / grid.resolution + 1.0 for place, first in zip(position, grid.origin, strict=True))
    for image, reach in zip(images, reaches, strict=True):
        _draw(grid.padded, x, y, 2.0 * reach / (IMAGE_SIDE * grid.resolution), image)
    return images


@njit(cache=True, nogil=True)
def _draw(cells: NDArray[np.int8], x: float, y: float, pixel: float, image: NDArray[np.uint8]) -> None:
    """Fill an image of pixels ``pixel`` cells wide around (x, y), in cells."""
    rows, columns = cells.shape
    half = IMAGE_SIDE * _SAMPLES / 2.0
    step = pixel / _SAMPLES
    samples = _SAMPLES * _SAMPLES
    for at in range(IMAGE_SIDE * IMAGE_SIDE):
        top, left = at // IMAGE_SIDE * _SAMPLES, at % IMAGE_SIDE * _SAMPLES
        free = 0
        occupied = 0
        for i in range(_SAMPLES):
            row = int(np.floor(y + (top + i + 0.5 - half) * step))
            if row < 0 or row >= rows:
                continue
            for j in range(_SAMPLES):
                column = int(np.floor(x + (left + j + 0.5 - half) * step))
                if 0 <= column < columns:
                    free += cells[row, column] == FREE
                    occupied += cells[row, column] == OCCUPIED
        # Both are rounded down, so that they never add up to more than the whole.
        image[at] = (free * _SHARES // samples) << 4 | (occupied * _SHARES // samples)
