"""The belief and the graph's nodes on one raster of lattice cells, for networks that see walls where graphs see none.

The images of an observation (see `common.mapping.occupancy_image`) are read in cells of 2 x 2 pixels, so that a
viewpoint in the middle of its lattice square lies in the middle of a cell: of the near image a cell is one lattice step
wide, of the far one four. 23 cells to a side are drawn, the robot's in the middle; the last row and the last column are
empty, so that a network can halve the raster.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.observations.feature_sets import DISTANCE_SCALE, FEATURE_NAMES
from common.observations.observation import IMAGE_SIDE, IMAGES, STEP_UNITS
from common.system.jit import njit

RASTER_SIDE: Final = IMAGE_SIDE // 2
RASTER_STEPS: Final = (1, 4)
"""Lattice steps to a cell of each image."""
SUBCELLS: Final = 4
"""Pixels of a cell: lower left, lower right, upper left, upper right."""
RASTER_CHANNELS: Final = 3 * SUBCELLS + 8
"""Of each subcell the share that is free, that is occupied, and that is free beside unknown space; then of the cell
whether a viewpoint is there, a visited one, the largest utility (as its feature), a beacon, the target, how near its
viewpoints are to the robot and to a useful viewpoint (exp(-d / 5) of d lattice steps along the graph), and which image
it is."""
CELLS: Final = len(IMAGES) * RASTER_SIDE**2
"""Cells of both images of an observation."""

_MIDDLE = RASTER_SIDE // 2 - 1
_NEAR_STEPS = 5.0
_NAMES = FEATURE_NAMES["extended"]
_UTILITY, _VISITED, _BEACON, _TARGET = (_NAMES.index(name) for name in ("utility", "visited", "beacon", "target"))
_TO_ROBOT, _TO_USEFUL = _NAMES.index("robot_graph_distance"), _NAMES.index("useful_graph_distance")
_VIEWPOINT = 3 * SUBCELLS


def belief_raster(
    image: NDArray[np.uint8], features: NDArray[np.float32], node_ptr: NDArray[np.int64]
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Draw k observations.

    Args:
        image: of the observations, drawn in lattice steps, uint8, shape (k, 2, pixels).
        features: of all their nodes, of the set ``extended`` or ``guided``, shape (nodes, F).
        node_ptr: first node of each observation, then their number, shape (k + 1,).

    Returns:
        The rasters, rows along y, float32, shape (k, 2, `RASTER_CHANNELS`, side, side); and the cell of each node in
        the nearest image that shows it, counted through all cells of all images, the number of all cells where none
        does, int64, shape (nodes,).
    """
    raster = np.zeros((len(image), len(IMAGES), RASTER_CHANNELS, RASTER_SIDE, RASTER_SIDE), dtype=np.float32)
    cells = np.full(len(features), len(image) * CELLS, dtype=np.int64)
    _draw_belief(image.reshape(len(image), len(IMAGES), IMAGE_SIDE, IMAGE_SIDE), raster)
    _draw_nodes(features, node_ptr, raster, cells)
    return raster, cells


@njit(cache=True, nogil=True)
def _draw_belief(image: NDArray[np.uint8], raster: NDArray[np.float32]) -> None:
    for g in range(image.shape[0]):
        for picture in range(image.shape[1]):
            pixels = image[g, picture]
            for y in range(RASTER_SIDE - 1):
                for x in range(RASTER_SIDE - 1):
                    for sub in range(SUBCELLS):
                        row, column = 2 * y + 1 + sub // 2, 2 * x + 1 + sub % 2
                        free, occupied = pixels[row, column] >> 4, pixels[row, column] & 15
                        unknown = 15 - free - occupied
                        for down, right in ((-1, 0), (1, 0), (0, -1), (0, 1)):
                            beside = pixels[row + down, column + right]
                            unknown = max(unknown, 15 - (beside >> 4) - (beside & 15))
                        raster[g, picture, sub, y, x] = free / 15.0
                        raster[g, picture, SUBCELLS + sub, y, x] = occupied / 15.0
                        raster[g, picture, 2 * SUBCELLS + sub, y, x] = free * unknown / 225.0
                    raster[g, picture, RASTER_CHANNELS - 1, y, x] = picture


@njit(cache=True, nogil=True)
def _draw_nodes(
    features: NDArray[np.float32],
    node_ptr: NDArray[np.int64],
    raster: NDArray[np.float32],
    cells: NDArray[np.int64],
) -> None:
    outside = raster.shape[0] * CELLS
    for g in range(raster.shape[0]):
        for row in range(node_ptr[g], node_ptr[g + 1]):
            values = features[row]
            for picture in range(raster.shape[1]):
                x = _cell(values[0], RASTER_STEPS[picture])
                y = _cell(values[1], RASTER_STEPS[picture])
                if min(x, y) < 0 or max(x, y) >= RASTER_SIDE - 1:
                    continue
                if cells[row] == outside:
                    cells[row] = (g * raster.shape[1] + picture) * RASTER_SIDE**2 + y * RASTER_SIDE + x
                mark = raster[g, picture, _VIEWPOINT:, y, x]
                if values[_TARGET] > 0.0:
                    mark[4] = 1.0
                    continue
                mark[0] = 1.0
                mark[1] = max(mark[1], values[_VISITED])
                mark[2] = max(mark[2], values[_UTILITY])
                mark[3] = max(mark[3], values[_BEACON])
                mark[5] = max(mark[5], math.exp(-values[_TO_ROBOT] * DISTANCE_SCALE / _NEAR_STEPS))
                mark[6] = max(mark[6], math.exp(-values[_TO_USEFUL] * DISTANCE_SCALE / _NEAR_STEPS))


@njit(cache=True, nogil=True)
def _cell(position: float, steps: int) -> int:
    """Return the column, or row, of a position feature; halves go away from the robot, as mirrored worlds must."""
    # Positions are whole units, which the feature tells all but exactly.
    place = np.rint(abs(position) * DISTANCE_SCALE * STEP_UNITS) / (STEP_UNITS * steps)
    away = int(place + 0.5)
    return _MIDDLE + away if position > 0.0 else _MIDDLE - away
