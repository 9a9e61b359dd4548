"""A true map as the robot's own mapping would know it, and where on it a robot of some radius can be."""

from __future__ import annotations

from math import ceil
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.maps.grid_map import GridMap
from common.errors import MapError
from common.mapping.belief import Belief
from common.mapping.clearance import TIGHT, Clearance
from common.mapping.pieces import Cells
from common.mapping.sight import FREE, NOTHING_LOST, OCCUPIED
from common.mapping.standing import MARGIN_REACH, nearest_clear

# Cells of other sides meet at borders that are equal up to rounding, in cells.
_ROUNDING: Final = 1e-6


def known_cells(world: GridMap, resolution: float | None = None) -> NDArray[np.int8]:
    """Return the cells of a belief in which all of a world is known, int8, row 0 at the bottom.

    Args:
        world: the true map.
        resolution: side of the belief's cells, metres, counted from the world's origin; that of the world when not
            given, and then the shape is that of ``world.free``. A cell of another side is free where all of it is: the
            robot's beams end on the faces of walls, and so mark the cells that walls reach into.
    """
    free = world.free
    if resolution is not None and resolution != world.resolution:
        free = _all_free(_all_free(free, world.resolution / resolution, 0), world.resolution / resolution, 1)
    return np.where(free, np.int8(FREE), np.int8(OCCUPIED))


def _all_free(free: NDArray[np.bool_], side: float, axis: int) -> NDArray[np.bool_]:
    """Return along one axis which cells of side 1 reach over nothing but free ones of another side."""
    count = free.shape[axis]
    borders = np.arange(ceil(count * side - _ROUNDING) + 1) / side
    first = np.floor(borders[:-1] + _ROUNDING).astype(np.int64)
    behind = np.ceil(borders[1:] - _ROUNDING).astype(np.int64)
    sums = np.insert(np.cumsum(free, axis=axis, dtype=np.int32), 0, 0, axis=axis)
    # A last cell that reaches out of the world misses some, so it is not free.
    found = np.take(sums, np.minimum(behind, count), axis) - np.take(sums, first, axis)
    return np.asarray(found == np.expand_dims(behind - first, 1 - axis), dtype=np.bool_)


def clear_space(world: GridMap, radius: float) -> tuple[NDArray[np.bool_], tuple[int, int]]:
    """Find where the middle of a robot may be, and where it begins.

    It is the clear space of the mapping (`Clearance`) with all of the world known; so what is 4-connected here is what
    the robot's viewpoint graph leads to. A robot that starts beside clear space begins in the nearest clear cell that
    it sees, as it does there.

    Args:
        world: the true map.
        radius: of the robot, metres, 0 allowed.

    Returns:
        Cells that are clear, bool, shape of ``world.free``; and the (row, column) of the cell where it begins, which is
        one of them.

    Raises:
        MapError: the start is not in free space, or the robot does not fit there.
    """
    if not world.is_free(world.start):
        raise MapError(f"map {world.name!r}: the start {world.start} is not in free space; move the start marker")
    if radius <= 0.0:
        return world.free, world.cell(world.start)
    rows, columns = world.free.shape
    width, height = world.size
    (x, y), resolution = world.origin, world.resolution
    belief = Belief(resolution, 1.0, bounds=(x, y, x + width, y + height))
    belief.assign(known_cells(world), world.origin)
    clearance = Clearance(belief, radius)
    clearance.refresh(belief.padded, (1, rows, 1, columns), NOTHING_LOST)
    clear = clearance.grid[1:-1, 1:-1] <= TIGHT
    cell = belief.cell(world.start)
    if clear[cell]:
        return clear, cell
    flat = clearance.grid.reshape(-1)
    cells = Cells(belief.padded.reshape(-1), flat, np.empty(0, np.uint16), np.empty(0, np.bool_), columns + 2)
    found = int(nearest_clear(cells, *belief.subcells(world.start), ceil((radius + MARGIN_REACH) / resolution)))
    if found < 0:
        raise MapError(
            f"map {world.name!r}: a robot of radius {radius:g} m does not fit at its start {world.start}, nor within "
            f"{MARGIN_REACH:g} m of it: move the start, or use a smaller mapping.robot_radius"
        )
    return clear, (found // (columns + 2) - 1, found % (columns + 2) - 1)
