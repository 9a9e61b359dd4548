"""Who sees what: frontier cells from viewpoints, and the unknown area that a sensor would meet."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.mapping.belief import Belief
from common.mapping.cell_grid import CellGrid
from common.mapping.mapper import Mapper
from common.mapping.raycast import SUBCELL_BITS, SUBCELLS
from common.mapping.sight import CLEAR, FREE, OCCUPIED, OUTSIDE, blocker
from common.system.jit import njit

# Rays that measure the unknown area around a point.
GAIN_RAYS: Final = 90


def subcells(belief: CellGrid, positions: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return positions, metres, shape (n, 2), in subcells of the padded grid (see `common.mapping.sight`)."""
    cells = (positions - np.array(belief.origin)) / belief.resolution + 1.0
    return np.rint(cells * SUBCELLS).astype(np.int64)


def metres(belief: CellGrid, points: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return points in subcells of the padded grid, shape (n, 2), in metres: the reverse of `subcells`."""
    return (points / SUBCELLS - 1.0) * belief.resolution + np.array(belief.origin)


@njit(cache=True, nogil=True)
def _at_ease(cells: NDArray[np.int8], width: int, points: NDArray[np.int64]) -> NDArray[np.bool_]:
    free = np.empty(len(points), dtype=np.bool_)
    for k in range(len(points)):
        x, y = points[k, 0], points[k, 1]
        free[k] = blocker(cells, width, x, y, x, y) == CLEAR
    return free


def at_ease(clear: CellGrid, positions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return at which positions, metres, shape (n, 2), straight lines may begin: they touch only clear cells, bool."""
    padded = clear.padded
    return np.asarray(_at_ease(padded.reshape(-1), padded.shape[1], subcells(clear, positions)))


@njit(cache=True, nogil=True)
def _observed(
    cells: NDArray[np.int8],
    width: int,
    viewpoints: NDArray[np.int64],
    points: NDArray[np.int64],
    reach: int,
) -> NDArray[np.bool_]:
    seen = np.zeros((len(viewpoints), len(points)), dtype=np.bool_)
    for v in range(len(viewpoints)):
        x, y = viewpoints[v, 0], viewpoints[v, 1]
        for p in range(len(points)):
            dx, dy = points[p, 0] - x, points[p, 1] - y
            if -reach <= dx <= reach and -reach <= dy <= reach and dx * dx + dy * dy <= reach * reach:
                seen[v, p] = blocker(cells, width, points[p, 0], points[p, 1], x, y) == CLEAR
    return seen


def observed(
    belief: Belief, viewpoints: NDArray[np.float64], points: NDArray[np.float64], reach: float
) -> NDArray[np.bool_]:
    """Return which points are in range and in line of sight of which viewpoints.

    Args:
        belief: what the robot knows; lines of sight run through known free cells.
        viewpoints: metres, in free cells, shape (n, 2).
        points: metres, in free cells, shape (m, 2).
        reach: metres.

    Returns:
        bool, shape (n, m); for the frontiers of a mapper and its observable range, its rows sum up to the utility.
    """
    padded = belief.padded
    return _observed(
        padded.reshape(-1),
        padded.shape[1],
        subcells(belief, viewpoints),
        subcells(belief, points),
        round(reach / belief.resolution * SUBCELLS),
    )


@njit(cache=True, nogil=True, inline="always")
def _axis(start: float, direction: float) -> tuple[int, float, float]:
    """Return step, distance to the first border and between borders of cells along one axis of a ray, in cells."""
    if direction > 0.0:
        return 1, (np.floor(start) + 1.0 - start) / direction, 1.0 / direction
    if direction < 0.0:
        return -1, (np.floor(start) - start) / direction, -1.0 / direction
    return 0, np.inf, np.inf


@njit(cache=True, nogil=True)
def _unknown_in_sight(
    cells: NDArray[np.int8],
    width: int,
    entrances: NDArray[np.bool_],
    points: NDArray[np.int64],
    reach: float,
    angles: NDArray[np.float64],
    enough: float,
) -> NDArray[np.float64]:
    areas = np.zeros(len(points))
    cosines, sines = np.cos(angles), np.sin(angles)
    for p in range(len(points)):
        x, y = points[p, 0], points[p, 1]
        start_x, start_y = x / SUBCELLS, y / SUBCELLS
        first = (y >> SUBCELL_BITS) * width + (x >> SUBCELL_BITS)
        for ray in range(len(angles)):
            if areas[p] > enough:
                break
            step_x, next_x, delta_x = _axis(start_x, cosines[ray])
            step_y, next_y, delta_y = _axis(start_y, sines[ray])
            step_y *= width
            index = first
            entered = 0.0
            while entered < reach:
                value = cells[index]
                if value == OCCUPIED:
                    break
                if value == OUTSIDE:
                    # All that lies beyond the grid is unknown.
                    areas[p] += reach * reach - entered * entered
                    break
                leaves = min(next_x, next_y, reach)
                if value != FREE:
                    areas[p] += leaves * leaves - entered * entered
                before = index
                if next_x < next_y:
                    entered = next_x
                    index += step_x
                    next_x += delta_x
                else:
                    entered = next_y
                    index += step_y
                    next_y += delta_y
                if value == FREE and cells[index] < 0 and not entrances[before]:
                    break
    return areas * np.pi / len(angles)


def unknown_in_sight(
    mapper: Mapper, points: NDArray[np.float64], reach: float, rays: int = GAIN_RAYS, enough: float = np.inf
) -> NDArray[np.float64]:
    """Return the unknown area that a sensor at each point would meet before the first known wall, square metres.

    Unknown cells hide nothing: a ray continues through them, as in the volumetric gain of Bircher et al. (2016). It
    must enter them at a frontier, however: a single cell of a wall that no beam happened to hit is no window.

    Args:
        mapper: updated.
        points: metres, in free cells, shape (n, 2).
        reach: range of the sensor, metres.
        rays: evenly spread over the circle; each stands for its sector.
        enough: a point that shows more than this is not measured to the end, square metres.
    """
    belief = mapper.belief
    padded = belief.padded
    entrances = np.zeros(padded.shape, dtype=np.bool_)
    columns, rows = (subcells(belief, mapper.frontiers) >> SUBCELL_BITS).T
    entrances[rows, columns] = True
    angles = (np.arange(rays, dtype=np.float64) + 0.5) * (2.0 * np.pi / rays)
    sector = np.pi / rays * belief.resolution**2
    areas = _unknown_in_sight(
        padded.reshape(-1),
        padded.shape[1],
        entrances.reshape(-1),
        subcells(belief, points),
        reach / belief.resolution,
        angles,
        enough / sector,
    )
    return areas * belief.resolution**2
