"""Exact traversal of grid cells: range rays against a true map, and lines of sight through known free cells.

Both rest on one conversion, `to_subcells`: a position becomes a whole number of 1/65536 cells. That is the only place
where floating-point error of a position is met (130.0 m / 0.25 m must be cell 520 and not 519), and it makes lines of
sight exact integer geometry: no tolerance, the same answer from both ends.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.system.jit import njit

SUBCELL_BITS: Final = 16
SUBCELLS: Final = 1 << SUBCELL_BITS
# Along a ray, distances are whole numbers of this part of a cell: adding integers is what makes traversal fast, and the
# rounding of a thousand borders adds up to 5e-10 cells.
RAY_UNITS: Final = float(1 << 40)
# No ray goes farther, cells: twice this must fit into 63 bits.
FARTHEST: Final = 4.0e6
# Two cell borders that a ray crosses within this many units (1e-9 cells) of each other are crossed at their corner.
CORNER_TOLERANCE: Final = 1100
# A direction whose sine or cosine is below this runs along the grid: cos(pi / 2) is 6e-17, not 0.
AXIS_TOLERANCE: Final = 1e-12


@njit(cache=True, nogil=True, inline="always")
def to_subcells(value: float, origin: float, resolution: float) -> int:
    """Convert a coordinate in metres into 1/65536 cells from the grid's origin, rounded to the nearest."""
    return int(np.rint((value - origin) / resolution * SUBCELLS))


@njit(cache=True, nogil=True, inline="always")
def cell_middle(cell: int, width: int) -> tuple[int, int]:
    """Return x and y of the middle of a cell, given by its flat number in a grid of so many cells per row, subcells."""
    return ((cell % width) << SUBCELL_BITS) + SUBCELLS // 2, ((cell // width) << SUBCELL_BITS) + SUBCELLS // 2


@njit(cache=True, nogil=True, inline="always")
def ray_units(cells: float) -> int:
    """Convert a distance along a ray from cells into `RAY_UNITS`, at most `FARTHEST`."""
    return int(min(cells, FARTHEST) * RAY_UNITS)


@njit(cache=True, nogil=True, inline="always")
def ray_axis(start: float, direction: float) -> tuple[int, int, int]:
    """Prepare one axis of a traversal (Amanatides and Woo, 1987).

    Args:
        start: coordinate in cells.
        direction: sine or cosine of the ray.

    Returns:
        Step (-1, 0, 1), distance along the ray to the first cell border, and distance between borders, in ray units.
    """
    if direction > AXIS_TOLERANCE:
        return 1, ray_units((np.floor(start) + 1.0 - start) / direction), ray_units(1.0 / direction)
    if direction < -AXIS_TOLERANCE:
        return -1, ray_units((np.floor(start) - start) / direction), ray_units(-1.0 / direction)
    return 0, ray_units(FARTHEST), ray_units(FARTHEST)


@njit(cache=True, nogil=True, inline="always")
def enter_next_cell(
    cell: int, step_x: int, step_y: int, next_x: int, next_y: int, delta_x: int, delta_y: int
) -> tuple[int, int, int]:
    """Cross the nearer border of a ray's cell, or both at their corner.

    Args:
        cell: flat number of the ray's cell.
        step_x: what crossing a border along x adds to the number.
        step_y: likewise along y: as many as there are cells in a row, with the ray's sign.
        next_x: distance along the ray to the next border along x, ray units.
        next_y: likewise along y.
        delta_x: distance between two borders along x, ray units.
        delta_y: likewise along y.

    Returns:
        The number of the cell that the ray enters, and its ``next_x`` and ``next_y``.
    """
    if next_x < next_y - CORNER_TOLERANCE:
        return cell + step_x, next_x + delta_x, next_y
    if next_y < next_x - CORNER_TOLERANCE:
        return cell + step_y, next_x, next_y + delta_y
    return cell + step_x + step_y, next_x + delta_x, next_y + delta_y


@njit(cache=True, nogil=True, inline="always")
def cell_behind_border(
    cell: int, step_x: int, step_y: int, next_x: int, next_y: int, delta_x: int, delta_y: int, end: int
) -> int:
    """Return the cell that a ray met at the border of `cell` where it ended, -1 where that does not tell.

    It does not at a corner, nor where the ray's end, `end` ray units, may lie beyond the cell behind the border. Other
    arguments as for `enter_next_cell`.
    """
    if abs(next_x - next_y) <= CORNER_TOLERANCE:
        return -1
    met, next_x, next_y = enter_next_cell(cell, step_x, step_y, next_x, next_y, delta_x, delta_y)
    return met if min(next_x, next_y) > end else -1


@njit(cache=True, nogil=True)
def cast_rays(
    free: NDArray[np.bool_],
    resolution: float,
    origin_x: float,
    origin_y: float,
    x: float,
    y: float,
    angles: NDArray[np.float64],
    range_max: float,
) -> NDArray[np.float32]:
    """Measure the distance to the first occupied cell along each ray.

    Everything outside the grid is occupied. A ray through the common corner of four cells is stopped when the
    opposite cell or both cells beside the corner are occupied; touching a single corner does not stop it.

    Args:
        free: true map, bool, shape (rows, columns), row 0 at the bottom.
        resolution: metres per cell.
        origin_x: x of the grid's lower left corner, metres.
        origin_y: y of the grid's lower left corner, metres.
        x: start of all rays, metres; in an occupied cell every range is 0.
        y: start of all rays, metres.
        angles: directions in the map frame, radians, float64, shape (beams,).
        range_max: metres.

    Returns:
        Ranges in metres, float32, shape (beams,); infinite where nothing is met nearer than `range_max`.
    """
    rows, columns = free.shape
    ranges = np.full(len(angles), np.inf, dtype=np.float32)
    start_x = to_subcells(x, origin_x, resolution) / SUBCELLS
    start_y = to_subcells(y, origin_y, resolution) / SUBCELLS
    start_column = int(np.floor(start_x))
    start_row = int(np.floor(start_y))
    if not (0 <= start_row < rows and 0 <= start_column < columns and free[start_row, start_column]):
        ranges[:] = 0.0
        return ranges
    limit = ray_units(range_max / resolution)
    for beam in range(len(angles)):
        step_x, next_x, delta_x = ray_axis(start_x, np.cos(angles[beam]))
        step_y, next_y, delta_y = ray_axis(start_y, np.sin(angles[beam]))
        column = start_column
        row = start_row
        while True:
            if next_x < next_y - CORNER_TOLERANCE:
                travelled = next_x
                column += step_x
                next_x += delta_x
            elif next_y < next_x - CORNER_TOLERANCE:
                travelled = next_y
                row += step_y
                next_y += delta_y
            else:
                travelled = next_x
                beside_x = 0 <= column + step_x < columns and free[row, column + step_x]
                beside_y = 0 <= row + step_y < rows and free[row + step_y, column]
                column += step_x
                row += step_y
                next_x += delta_x
                next_y += delta_y
                if not beside_x and not beside_y:
                    row = -1
            if travelled >= limit:
                break
            if not (0 <= row < rows and 0 <= column < columns and free[row, column]):
                ranges[beam] = travelled / RAY_UNITS * resolution
                break
    return ranges


def ray_angles(yaw: float, angle_min: float, angle_increment: float, beams: int) -> NDArray[np.float64]:
    """Return the directions of a scan's beams in the map frame, radians, shape (beams,)."""
    return yaw + angle_min + angle_increment * np.arange(beams, dtype=np.float64)
