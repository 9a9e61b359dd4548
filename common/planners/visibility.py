"""Who sees what: frontier cells from viewpoints, and the unknown area that a sensor would meet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.jit import njit
from common.mapping.belief import Belief
from common.mapping.raycast import SUBCELL_BITS, SUBCELLS, ray_axis
from common.mapping.sight import CLEAR, FREE, OCCUPIED, OUTSIDE, blocker


def subcells(belief: Belief, positions: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return positions, metres, shape (n, 2), in subcells of the padded grid (see `common.mapping.sight`)."""
    cells = (positions - np.array(belief.origin)) / belief.resolution + 1.0
    return np.rint(cells * SUBCELLS).astype(np.int64)


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
        bool, shape (n, m); its rows sum up to the utility where `reach` is the observable range.
    """
    padded = belief.padded
    return _observed(
        padded.reshape(-1),
        padded.shape[1],
        subcells(belief, viewpoints),
        subcells(belief, points),
        round(reach / belief.resolution * SUBCELLS),
    )


@njit(cache=True, nogil=True)
def unknown_in_sight(
    cells: NDArray[np.int8],
    width: int,
    x: int,
    y: int,
    reach: float,
    cosines: NDArray[np.float64],
    sines: NDArray[np.float64],
) -> float:
    """Return the unknown area that rays from a point meet before the first known wall.

    Unknown cells hide nothing: a ray goes on through them, as in the volumetric gain of Bircher et al. (2016).

    Args:
        cells: padded grid, flat, int8.
        width: its cells per row.
        x: of the sensor, subcells, in a free cell.
        y: likewise.
        reach: range of the sensor, cells.
        cosines: of the rays' directions, evenly spread over the circle, shape (rays,).
        sines: likewise.

    Returns:
        Area in cells: each stretch of a ray stands for its sector of the ring.
    """
    start_x, start_y = x / SUBCELLS, y / SUBCELLS
    first = (y >> SUBCELL_BITS) * width + (x >> SUBCELL_BITS)
    area = 0.0
    for ray in range(len(cosines)):
        step_x, next_x, delta_x = ray_axis(start_x, cosines[ray])
        step_y, next_y, delta_y = ray_axis(start_y, sines[ray])
        step_y *= width
        index = first
        entered = 0.0
        while entered < reach:
            value = cells[index]
            if value in (OCCUPIED, OUTSIDE):
                break
            leaves = min(next_x, next_y, reach)
            if value != FREE:
                area += leaves * leaves - entered * entered
            if next_x < next_y:
                entered = next_x
                index += step_x
                next_x += delta_x
            else:
                entered = next_y
                index += step_y
                next_y += delta_y
    return area * np.pi / len(cosines)
