"""What each true viewpoint sees, at full resolution: bit sets over tiles of 8 x 8 cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.system.jit import njit
from common.tours.sighting import Visibility


@njit(cache=True, nogil=True)
def _look_around(
    free: NDArray[np.bool_],
    x: float,
    y: float,
    reach: float,
    cosines: NDArray[np.float64],
    sines: NDArray[np.float64],
    words: NDArray[np.uint64],
    touched: NDArray[np.int32],
) -> int:
    """Set the bits of all free cells that the beams from (x, y) cross; return the number of touched tiles.

    Coordinates in cells. Each beam is followed cell by cell (Amanatides and Woo) until a wall or ``reach``.
    """
    rows, columns = free.shape
    tile_columns = (columns + 7) >> 3
    count = 0
    for b in range(len(cosines)):
        ux, uy = cosines[b], sines[b]
        c, r = int(np.floor(x)), int(np.floor(y))
        step_c = 1 if ux > 0 else -1
        step_r = 1 if uy > 0 else -1
        delta_c = abs(1.0 / ux) if abs(ux) > 1e-12 else np.inf
        delta_r = abs(1.0 / uy) if abs(uy) > 1e-12 else np.inf
        next_c = ((c + 1 - x) if ux > 0 else (x - c)) * delta_c if delta_c < np.inf else np.inf
        next_r = ((r + 1 - y) if uy > 0 else (y - r)) * delta_r if delta_r < np.inf else np.inf
        travelled = 0.0
        while travelled <= reach:
            if r < 0 or r >= rows or c < 0 or c >= columns or not free[r, c]:
                break
            tile = (r >> 3) * tile_columns + (c >> 3)
            if words[tile] == 0:
                touched[count] = tile
                count += 1
            words[tile] |= np.uint64(1) << np.uint64(((r & 7) << 3) | (c & 7))
            if next_c < next_r:
                travelled = next_c
                next_c += delta_c
                c += step_c
            else:
                travelled = next_r
                next_r += delta_r
                r += step_r
    return count


@njit(cache=True, nogil=True)
def _look_from_all(
    free: NDArray[np.bool_],
    points: NDArray[np.float64],
    reach: float,
    cosines: NDArray[np.float64],
    sines: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.uint64]]:
    rows, columns = free.shape
    tiles = ((rows + 7) >> 3) * ((columns + 7) >> 3)
    words = np.zeros(tiles, dtype=np.uint64)
    touched = np.empty(tiles, dtype=np.int32)
    n = len(points)
    pointer = np.zeros(n + 1, dtype=np.int64)
    tile = np.empty(max(64 * n, 1024), dtype=np.int32)
    mask = np.empty(len(tile), dtype=np.uint64)
    size = 0
    for v in range(n):
        count = _look_around(free, points[v, 0], points[v, 1], reach, cosines, sines, words, touched)
        while size + count > len(tile):
            tile = np.concatenate((tile, np.empty(len(tile), dtype=np.int32)))
            mask = np.concatenate((mask, np.empty(len(mask), dtype=np.uint64)))
        for k in range(count):
            tile[size] = touched[k]
            mask[size] = words[touched[k]]
            words[touched[k]] = np.uint64(0)
            size += 1
        pointer[v + 1] = size
    return pointer, tile[:size].copy(), mask[:size].copy()


@njit(cache=True, nogil=True)
def fill_words(cells: NDArray[np.int64], columns: int, words: NDArray[np.uint64]) -> None:
    """Write a set of cells (flat numbers, ascending) into tile words, which are cleared first."""
    words[:] = np.uint64(0)
    tile_columns = (columns + 7) >> 3
    r = 0
    first = 0
    for i in range(len(cells)):
        while cells[i] >= first + columns:
            r += 1
            first += columns
        c = cells[i] - first
        words[(r >> 3) * tile_columns + (c >> 3)] |= np.uint64(1) << np.uint64(((r & 7) << 3) | (c & 7))


def look_from_all(free: NDArray[np.bool_], points: NDArray[np.float64], reach: float, beams: int) -> Visibility:
    """Look from every point (cell coordinates) with a number of beams, up to ``reach`` cells."""
    angles = np.arange(beams) * (2.0 * np.pi / beams)
    rows, columns = free.shape
    pointer, tile, mask = _look_from_all(np.ascontiguousarray(free), points, reach, np.cos(angles), np.sin(angles))
    return Visibility(pointer, tile, mask, ((rows + 7) >> 3) * ((columns + 7) >> 3))
