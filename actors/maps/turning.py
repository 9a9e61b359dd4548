"""Lays a map that was recorded at an angle along the axes of its own frame.

By a multiple of 90 degrees nothing is resampled. By any other angle the map gets cells of half the size, and each takes
what its centre lies on. The largest square without one of these centres in it is smaller than an old cell, so no free
cell is lost and no hole appears. Where two free cells touched with a corner only, between two that are not free, the
new cells are cut apart there: what was connected (over edges of cells) stays connected, and what was not stays apart.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.errors import MapError
from common.system.jit import njit

MAX_SIDE: Final = 16_384
"""Cells on a side of a turned map."""
# Radians: moves no cell of the largest image by more than a quarter of a cell, and is more than what 1.5708 lacks.
_NEGLIGIBLE: Final = 3e-5
# New cells along the side of an old one, where the angle is no multiple of 90 degrees.
_FINER: Final = 2


def turn(
    free: NDArray[np.bool_], resolution: float, origin: tuple[float, float], yaw: float
) -> tuple[NDArray[np.bool_], float, tuple[float, float]]:
    """Turn a map about its origin until its cells lie along the axes.

    Args:
        free: bool, shape (rows, columns), row 0 at the bottom, in the map's own axes.
        resolution: metres per cell.
        origin: (x, y) of the lower left corner, metres.
        yaw: direction of the map's rows in the frame, radians, counter-clockwise.

    Returns:
        Cells (row 0 at the bottom; cropped to what is free where the angle is no multiple of 90 degrees), metres per
        cell, and (x, y) of their lower left corner.

    Raises:
        MapError: the result would be too large.
    """
    quarters = _quarters(yaw)
    if quarters is not None:
        return _quarter_turns(free, resolution, origin, quarters % 4)
    rows, columns = np.flatnonzero(free.any(axis=1)), np.flatnonzero(free.any(axis=0))
    bottom, top, left, right = (
        (rows[0], rows[-1] + 1, columns[0], columns[-1] + 1) if len(rows) else (0, free.shape[0], 0, free.shape[1])
    )
    cosine, sine = math.cos(yaw), math.sin(yaw)
    corners = resolution * np.array([(x, y) for x in (left, right) for y in (bottom, top)])
    turned = corners @ np.array([[cosine, sine], [-sine, cosine]]) + origin
    fine = turned_resolution(resolution, yaw)
    low = turned.min(axis=0)
    across, up = (int(cells) for cells in np.ceil((turned.max(axis=0) - low) / fine))
    if max(across, up) > MAX_SIDE:
        raise MapError(
            f"turned by its yaw of {yaw:g} rad the map would have {across} x {up} cells, at most {MAX_SIDE} on a side "
            "are allowed: crop the image, or turn it beforehand and give a yaw of 0"
        )
    # The frame's position of a new cell in cells of the old map: an affine map of (column, row).
    step = np.array([[cosine, sine], [-sine, cosine]]) * (fine / resolution)
    first = np.array([[cosine, sine], [-sine, cosine]]) @ (low + fine / 2 - origin) / resolution
    result = np.zeros((up, across), dtype=np.bool_)
    _sample(np.ascontiguousarray(free), result, first, step)
    return result, fine, (float(low[0]), float(low[1]))


def turned_resolution(resolution: float, yaw: float) -> float:
    """Return the metres per cell of a map that was turned."""
    return resolution if _quarters(yaw) is not None else resolution / _FINER


def _quarters(yaw: float) -> int | None:
    """Return how many right angles an angle is, None for any other."""
    quarters = round(yaw / (math.pi / 2))
    return quarters if abs(yaw - quarters * (math.pi / 2)) < _NEGLIGIBLE else None


def _quarter_turns(
    free: NDArray[np.bool_], resolution: float, origin: tuple[float, float], quarters: int
) -> tuple[NDArray[np.bool_], float, tuple[float, float]]:
    for _ in range(quarters):
        # (x, y) relative to the corner that stays becomes (-y, x).
        free = free.T[:, ::-1]
    width, height = free.shape[1] * resolution, free.shape[0] * resolution
    x, y = ((0.0, 0.0), (-width, 0.0), (-width, -height), (0.0, -height))[quarters]
    return np.ascontiguousarray(free), resolution, (origin[0] + x, origin[1] + y)


@njit(cache=True, nogil=True)
def _place(column: int, row: int, first: NDArray[np.float64], step: NDArray[np.float64]) -> tuple[float, float]:
    """Return the (x, y) of a new cell's centre, in old cells."""
    return (
        first[0] + step[0, 0] * column + step[0, 1] * row,
        first[1] + step[1, 0] * column + step[1, 1] * row,
    )


@njit(cache=True, nogil=True)
def _is_free(free: NDArray[np.bool_], column: float, row: float) -> bool:
    return 0 <= row < free.shape[0] and 0 <= column < free.shape[1] and free[int(row), int(column)]


@njit(cache=True, nogil=True)
def _sample(
    free: NDArray[np.bool_], result: NDArray[np.bool_], first: NDArray[np.float64], step: NDArray[np.float64]
) -> None:
    rows, columns = result.shape
    for row in range(rows):
        for column in range(columns):
            x, y = _place(column, row, first, step)
            result[row, column] = _is_free(free, np.floor(x), np.floor(y))
    for row in range(rows):
        for column in range(columns):
            for beside in range(2):
                left, below = column - (1 - beside), row - beside
                if left >= 0 and below >= 0 and result[row, column] and result[below, left]:
                    _cut(free, result, (column, row), (left, below), first, step)


@njit(cache=True, nogil=True)
def _cut(
    free: NDArray[np.bool_],
    result: NDArray[np.bool_],
    one: tuple[int, int],
    other: tuple[int, int],
    first: NDArray[np.float64],
    step: NDArray[np.float64],
) -> None:
    """Part two neighbouring new cells that lie on old ones with nothing but a corner in common."""
    x, y = _place(one[0], one[1], first, step)
    other_x, other_y = _place(other[0], other[1], first, step)
    corner_x, corner_y = max(np.floor(x), np.floor(other_x)), max(np.floor(y), np.floor(other_y))
    if np.floor(x) == np.floor(other_x) or np.floor(y) == np.floor(other_y):
        return
    if _is_free(free, np.floor(x), np.floor(other_y)) or _is_free(free, np.floor(other_x), np.floor(y)):
        return
    # The one nearer to the corner is at the tip of its old cell: all other cells there stay connected without it.
    nearer = np.hypot(x - corner_x, y - corner_y) < np.hypot(other_x - corner_x, other_y - corner_y)
    column, row = one if nearer else other
    result[row, column] = False
