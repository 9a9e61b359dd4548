"""The volume that a lidar has seen, as voxels that hold at least one of its points."""

from __future__ import annotations

from math import ceil
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.maps.grid_map import GridMap
from common.system.jit import njit

# Side of a voxel, metres: that of the explored volume in the paper's simulation environment.
VOXEL: Final = 0.5
# The floor (z = 0) and wall faces (multiples of the cell) lie inside of voxels, not on a border between two.
_BELOW_FLOOR: Final = 0.25
_BESIDE: Final = 0.125


@njit(cache=True, nogil=True)
def _mark(seen: NDArray[np.bool_], points: NDArray[np.float64], x: float, y: float, z: float, side: float) -> int:
    """Mark the voxels of points, shape (n, 3), and return how many are new; points outside are left out."""
    columns, rows, layers = seen.shape
    new = 0
    for k in range(len(points)):
        i = int(np.floor((points[k, 0] - x) / side))
        j = int(np.floor((points[k, 1] - y) / side))
        h = int(np.floor((points[k, 2] - z) / side))
        if 0 <= i < columns and 0 <= j < rows and 0 <= h < layers and not seen[i, j, h]:
            seen[i, j, h] = True
            new += 1
    return new


class VoxelMap:
    """Explored volume as the literature on exploration with 3D lidars counts it: voxels that points fell into.

    Surfaces alone have points (walls and floor), so it measures what was seen of them, not the air between.
    """

    def __init__(self, world: GridMap, height: float) -> None:
        """Begin with nothing seen; ``height`` of the walls, metres."""
        (x, y), (width, depth) = world.origin, world.size
        self._corner = (x - _BESIDE, y - _BESIDE, -_BELOW_FLOOR)
        shape = (ceil(width / VOXEL) + 1, ceil(depth / VOXEL) + 1, ceil((height + _BELOW_FLOOR) / VOXEL) + 1)
        self._seen = np.zeros(shape, dtype=np.bool_)
        self._count = 0

    def add(self, points: NDArray[np.float64]) -> None:
        """Add points, metres, map frame, shape (n, 3)."""
        self._count += _mark(self._seen, points, *self._corner, VOXEL)

    @property
    def volume(self) -> float:
        """Explored volume, cubic metres."""
        return self._count * VOXEL**3
