"""Turns a grid map into triangle meshes: wall faces merged along straight runs, and wall tops for pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from actors.maps.grid_map import GridMap
from common.system.copies import copy_rows
from common.system.jit import njit

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
    longest = max(1, round(LONGEST_FACE / world.resolution))
    line, first, end, sign = _border_runs(world.free, longest).T
    along_x = np.stack([first, line, end, line], axis=1)
    along_x[sign > 0] = along_x[sign > 0][:, [2, 3, 0, 1]]
    line, first, end, sign = _border_runs(np.ascontiguousarray(world.free.T), longest).T
    along_y = np.stack([line, first, line, end], axis=1)
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
    padded = np.pad(~world.free, ((0, 0), (1, 1)))
    line, first = np.nonzero(padded[:, 1:] & ~padded[:, :-1])
    _, last = np.nonzero(~padded[:, 1:] & padded[:, :-1])
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


@njit(cache=True, nogil=True)
def _border_runs(free: NDArray[np.bool_], longest: int) -> NDArray[np.int64]:
    """Find the borders between free and occupied cells along the lines between rows.

    Returns:
        (line, first, end, sign) per run of at most ``longest`` cells, int64, shape (n, 4): between rows line - 1 and
        line, columns first to end - 1; sign is 1 where the row ``line`` is the free one, else -1.
    """
    rows, columns = free.shape
    padded = np.zeros((rows + 2, columns + 1), dtype=np.bool_)
    copy_rows(padded[1:], free)
    runs = np.empty((256, 4), dtype=np.int64)
    count = 0
    for line in range(rows + 1):
        below, above = padded[line], padded[line + 1]
        differ = False
        for column in range(columns):
            differ |= below[column] != above[column]
        if not differ:
            continue
        first, open_sign = 0, 0
        for column in range(columns + 1):
            sign = int(above[column]) - int(below[column])
            if sign != open_sign or (open_sign != 0 and column - first == longest):
                if open_sign != 0:
                    if count == len(runs):
                        larger = np.empty((2 * count, 4), dtype=np.int64)
                        copy_rows(larger, runs)
                        runs = larger
                    runs[count, 0], runs[count, 1] = line, first
                    runs[count, 2], runs[count, 3] = column, open_sign
                    count += 1
                first, open_sign = column, sign
    return runs[:count]
