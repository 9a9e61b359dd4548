"""Turns a grid map into triangle meshes: wall faces merged along straight runs, and wall tops for pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from actors.maps.grid_map import GridMap

LONGEST_FACE = 16.0
"""Metres; Bullet's ray test makes a triangle larger by 1e-4 of its length, so very long ones would blur corners."""
_TRIANGLES_OF_QUAD = np.array([0, 1, 2, 0, 2, 3])


@dataclass(frozen=True, slots=True, eq=False)
class Quads:
    """Flat rectangles in 3D.

    Attributes:
        corners: metres, map frame, counter-clockwise as seen from the visible side, float64, shape (n, 4, 3).
    """

    corners: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.corners)

    def chunks(self, size: int) -> list[tuple[NDArray[np.float64], NDArray[np.int64]]]:
        """Return (vertices, indices) of triangle meshes with at most ``size`` quads each."""
        meshes = []
        for first in range(0, len(self), size):
            part = self.corners[first : first + size]
            indices = 4 * np.arange(len(part))[:, None] + _TRIANGLES_OF_QUAD
            meshes.append((part.reshape(-1, 3), indices.ravel()))
        return meshes


def wall_faces(world: GridMap, bottom: float, top: float) -> Quads:
    """Return the faces between free and occupied cells, each straight run as one quad that looks to the free side.

    Everything outside the grid is occupied. Neighbouring faces share their corners exactly, so that no ray slips
    through between them.
    """
    free = np.pad(world.free, 1).astype(np.int8)
    longest = max(1, round(LONGEST_FACE / world.resolution))
    # Lines along x: between row r - 1 and row r; +1 where the upper side is free. Then lines along y, likewise.
    line, first, last, sign = _runs(free[1:, :] - free[:-1, :], longest)
    along_x = np.stack([first - 1, line, last - 1, line], axis=1)
    along_x[sign > 0] = along_x[sign > 0][:, [2, 3, 0, 1]]
    line, first, last, sign = _runs((free[:, 1:] - free[:, :-1]).T, longest)
    along_y = np.stack([line, first - 1, line, last - 1], axis=1)
    along_y[sign < 0] = along_y[sign < 0][:, [2, 3, 0, 1]]
    ends = np.concatenate([along_x, along_y]) * world.resolution + np.tile(world.origin, 2)
    corners = np.empty((len(ends), 4, 3))
    corners[:, 0, :2] = corners[:, 3, :2] = ends[:, :2]
    corners[:, 1, :2] = corners[:, 2, :2] = ends[:, 2:]
    corners[:, :2, 2] = bottom
    corners[:, 2:, 2] = top
    return Quads(corners)


def wall_tops(world: GridMap, height: float) -> Quads:
    """Return the tops of the occupied cells of the grid, merged into rectangles, looking up."""
    line, first, last, _ = _runs((~world.free).astype(np.int8), max(world.free.shape) + 1)
    # A run that continues the same columns of the row below joins its rectangle.
    order = np.lexsort((line, last, first))
    line, first, last = line[order], first[order], last[order]
    fresh = np.ones(len(line), dtype=np.bool_)
    fresh[1:] = (first[1:] != first[:-1]) | (last[1:] != last[:-1]) | (line[1:] != line[:-1] + 1)
    heads = np.flatnonzero(fresh)
    tails = np.append(heads[1:], len(line)) - 1 if len(heads) else heads
    left, right, low, high = first[heads], last[heads], line[heads], line[tails] + 1
    corners = np.empty((len(heads), 4, 3))
    corners[:, 0, 0] = corners[:, 3, 0] = left
    corners[:, 1, 0] = corners[:, 2, 0] = right
    corners[:, 0, 1] = corners[:, 1, 1] = low
    corners[:, 2, 1] = corners[:, 3, 1] = high
    corners[:, :, :2] = corners[:, :, :2] * world.resolution + np.array(world.origin)
    corners[:, :, 2] = height
    return Quads(corners)


def _runs(
    sign: NDArray[np.int8], longest: int
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp], NDArray[np.int8]]:
    """Return (line, first, end, sign) of the runs of equal non-zero values along axis 1, cut at each ``longest``."""
    padded = np.pad(sign, ((0, 0), (1, 1)))
    change = padded[:, 1:] != padded[:, :-1]
    change[:, ::longest] = True
    line, first = np.nonzero(change & (padded[:, 1:] != 0))
    _, end = np.nonzero(change & (padded[:, :-1] != 0))
    return line, first, end, sign[line, first]
