"""Shapes that generators draw into a grid, in whole numbers and exact arithmetic, so that every machine agrees."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from actors.maps.layout import BLOCK
from common.system.jit import njit


@njit(cache=True, nogil=True)
def fill_disc(grid: NDArray[np.bool_], x: int, y: int, radius_squared: int, value: bool) -> None:
    """Set the cells whose centres lie in a disc.

    Args:
        grid: bool, changed in place.
        x: centre, in half cells from the lower left corner.
        y: likewise.
        radius_squared: in square half cells.
        value: what to set.
    """
    rows, columns = grid.shape
    reach = int(np.sqrt(radius_squared)) // 2 + 2
    for row in range(max(y // 2 - reach, 0), min(y // 2 + reach + 1, rows)):
        for column in range(max(x // 2 - reach, 0), min(x // 2 + reach + 1, columns)):
            dy, dx = 2 * row + 1 - y, 2 * column + 1 - x
            if dy * dy + dx * dx <= radius_squared:
                grid[row, column] = value


@njit(cache=True, nogil=True)
def carve_path(grid: NDArray[np.bool_], points: NDArray[np.int64], radii: NDArray[np.int64], step: int) -> None:
    """Free a band along a polyline whose half width changes from point to point.

    Args:
        grid: bool, changed in place.
        points: (x, y) in half cells, int64, shape (n, 2).
        radii: half width at each point, half cells, int64, shape (n,).
        step: distance between two discs, half cells.
    """
    for k in range(len(points) - 1):
        ax, ay, bx, by = points[k, 0], points[k, 1], points[k + 1, 0], points[k + 1, 1]
        pieces = max(abs(bx - ax), abs(by - ay)) // step + 1
        for piece in range(pieces + 1):
            x = ax + (bx - ax) * piece // pieces
            y = ay + (by - ay) * piece // pieces
            radius = radii[k] + (radii[k + 1] - radii[k]) * piece // pieces
            fill_disc(grid, x, y, radius * radius, True)


def smooth_noise(rng: np.random.Generator, shape: tuple[int, int], spacing: int) -> NDArray[np.int64]:
    """Return value noise: random numbers on a coarse lattice, bilinear between its points.

    Args:
        rng: source of chance.
        shape: (rows, columns).
        spacing: cells between two points of the coarse lattice.

    Returns:
        int64, 0 to 1000, shape ``shape``.
    """
    coarse = rng.integers(0, 1001, size=(shape[0] // spacing + 2, shape[1] // spacing + 2))
    return _interpolate(coarse, shape[0], shape[1], spacing)


@njit(cache=True, nogil=True)
def _interpolate(coarse: NDArray[np.int64], rows: int, columns: int, spacing: int) -> NDArray[np.int64]:
    mixed = np.empty((rows, columns), dtype=np.int64)
    for row in range(rows):
        j, up = row // spacing, row % spacing
        for i in range((columns - 1) // spacing + 1):
            left = coarse[j, i] * (spacing - up) + coarse[j + 1, i] * up
            right = coarse[j, i + 1] * (spacing - up) + coarse[j + 1, i + 1] * up
            for across in range(min(spacing, columns - i * spacing)):
                value = left * (spacing - across) + right * across
                mixed[row, i * spacing + across] = value // (spacing * spacing)
    return mixed


def wall(grid: NDArray[np.bool_], ax: int, ay: int, bx: int, by: int, thickness: int) -> None:
    """Put an axis-aligned wall between two points, pixels, with half of its thickness on either side."""
    half = thickness // 2
    grid[
        max(min(ay, by) - half, 0) : max(ay, by) + thickness - half,
        max(min(ax, bx) - half, 0) : max(ax, bx) + thickness - half,
    ] = False


def box_walls(grid: NDArray[np.bool_], area: tuple[int, int, int, int], thickness: int) -> None:
    """Put walls along the four sides of an area (left, bottom, width, height in blocks)."""
    left, bottom = area[0] * BLOCK, area[1] * BLOCK
    right, top = left + area[2] * BLOCK, bottom + area[3] * BLOCK
    wall(grid, left, bottom, right, bottom, thickness)
    wall(grid, left, top, right, top, thickness)
    wall(grid, left, bottom, left, top, thickness)
    wall(grid, right, bottom, right, top, thickness)


def door_up(grid: NDArray[np.bool_], column: int, row: int, width: int, thickness: int) -> None:
    """Open the wall below block row ``row`` on the lattice line of block column ``column``: a way along y."""
    x, y = lattice_line(column), row * BLOCK
    grid[y - thickness : y + thickness, x - width // 2 : x + width // 2] = True


def door_across(grid: NDArray[np.bool_], column: int, row: int, width: int, thickness: int) -> None:
    """Open the wall left of block column ``column`` on the lattice line of block row ``row``: a way along x."""
    x, y = column * BLOCK, lattice_line(row)
    grid[y - width // 2 : y + width // 2, x - thickness : x + thickness] = True


def small_boxes(rng: np.random.Generator, grid: NDArray[np.bool_], blocks: NDArray[np.int64]) -> None:
    """Put one box of 1 m or so into a quarter of each block, two pixels away from the lattice lines.

    Args:
        rng: source of sides and quarters.
        grid: bool, changed in place.
        blocks: (column, row) of the blocks, int64, shape (n, 2).
    """
    sides = rng.integers(3, 6, size=blocks.shape)
    halves = rng.integers(2, size=blocks.shape)
    # In the lower or left half a box ends two pixels before the line, in the other it begins two behind it.
    half = BLOCK // 2
    corners = blocks * BLOCK + np.where(halves == 1, half + 2, half - 2 - sides)
    for (x, y), (width, height) in zip(corners.tolist(), sides.tolist(), strict=True):
        grid[y : y + height, x : x + width] = False


def blocks_of(area: tuple[int, int, int, int]) -> NDArray[np.int64]:
    """Return (column, row) of each block of an area (left, bottom, width, height), row-major, shape (n, 2)."""
    left, bottom, width, height = area
    number = np.arange(width * height)
    return np.stack([left + number % width, bottom + number // width], axis=1)


def lattice_line(block: int) -> int:
    """Return the pixel of the lattice line through a row or column of blocks."""
    return block * BLOCK + BLOCK // 2
