"""Obstacles as polygons: contours of grid cells, simplified, and their convex corners."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.mapping.sight import OCCUPIED, Box
from common.system.copies import copy_rows, copy_values
from common.system.jit import njit

# Steps of the headings east, north, west and south.
_STEP_X: Final = np.array([1, 0, -1, 0], dtype=np.int64)
_STEP_Y: Final = np.array([0, 1, 0, -1], dtype=np.int64)
# The cell ahead on the left of a heading, from the corner of cells that it starts at.
_LEFT_X: Final = np.array([0, -1, -1, 0], dtype=np.int64)
_LEFT_Y: Final = np.array([0, 0, -1, -1], dtype=np.int64)
# The cell ahead on the right.
_RIGHT_X: Final = np.array([0, 0, -1, -1], dtype=np.int64)
_RIGHT_Y: Final = np.array([-1, 0, 0, -1], dtype=np.int64)


@njit(cache=True, nogil=True)
def _trace(
    solid: NDArray[np.bool_],
    starts: NDArray[np.int64],
    step_x: NDArray[np.int64],
    step_y: NDArray[np.int64],
    left_x: NDArray[np.int64],
    left_y: NDArray[np.int64],
    right_x: NDArray[np.int64],
    right_y: NDArray[np.int64],
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Follow all borders of solid cells, which lie on the left; see `trace`."""
    rows, columns = solid.shape
    seen = np.zeros((rows, columns), dtype=np.bool_)
    corners = np.empty((1024, 2), dtype=np.int32)
    ends = np.empty(64, dtype=np.int64)
    count = contours = 0
    for start in starts:
        x, y, heading = start % columns, start // columns, 0
        if seen[y, x]:
            continue
        while not (heading == 0 and seen[y, x]):
            if heading == 0:
                seen[y, x] = True
            x += step_x[heading]
            y += step_y[heading]
            turn = 0
            # Solid cells that meet in a corner belong together: nothing passes between them.
            if solid[y + right_y[heading], x + right_x[heading]]:
                turn = -1
            elif not solid[y + left_y[heading], x + left_x[heading]]:
                turn = 1
            if turn:
                heading = (heading + turn) % 4
                if count == len(corners):
                    more = np.empty((2 * count, 2), dtype=np.int32)
                    copy_rows(more, corners)
                    corners = more
                corners[count, 0], corners[count, 1] = x, y
                count += 1
        if contours == len(ends):
            longer = np.empty(2 * contours, dtype=np.int64)
            copy_values(longer, ends)
            ends = longer
        ends[contours] = count
        contours += 1
    return corners[:count], ends[:contours]


@njit(cache=True, nogil=True)
def _simplify(corners: NDArray[np.int32], tolerance: float) -> NDArray[np.bool_]:
    """Mark the corners of one closed contour that remain (Douglas and Peucker, 1973)."""
    n = len(corners)
    keep = np.zeros(n, dtype=np.bool_)
    # A closed line has no ends: begin with the first corner and the one farthest from it.
    far, farthest = 0, -1.0
    for k in range(n):
        gap = float((corners[k, 0] - corners[0, 0]) ** 2 + (corners[k, 1] - corners[0, 1]) ** 2)
        if gap > farthest:
            far, farthest = k, gap
    keep[0] = keep[far] = True
    stack = np.empty((n + 2, 2), dtype=np.int64)
    stack[0, 0], stack[0, 1] = 0, far
    stack[1, 0], stack[1, 1] = far, n
    size = 2
    while size:
        size -= 1
        a, b = stack[size, 0], stack[size, 1]
        ax, ay = float(corners[a, 0]), float(corners[a, 1])
        dx, dy = corners[b % n, 0] - ax, corners[b % n, 1] - ay
        square = dx * dx + dy * dy
        worst, at = tolerance * tolerance, -1
        for k in range(a + 1, b):
            px, py = corners[k, 0] - ax, corners[k, 1] - ay
            along = min(max((px * dx + py * dy) / square, 0.0), 1.0) if square > 0.0 else 0.0
            gap = (px - along * dx) ** 2 + (py - along * dy) ** 2
            if gap > worst:
                worst, at = gap, k
        if at >= 0:
            keep[at] = True
            stack[size, 0], stack[size, 1] = a, at
            stack[size + 1, 0], stack[size + 1, 1] = at, b
            size += 2
    return keep


def trace(solid: NDArray[np.bool_]) -> list[NDArray[np.int32]]:
    """Follow the borders of solid cells.

    Args:
        solid: bool, shape (rows, columns); the outermost ring of cells must not be solid.

    Returns:
        Closed contours, each its corners (x, y) in cells from the lower left corner, int32, shape (n, 2), solid cells
        on the left: outer borders run counter-clockwise, those of holes clockwise. Cells that touch in a corner belong
        together.
    """
    corners, ends = _borders(solid)
    return np.split(corners, ends[:-1]) if len(ends) else []


def _borders(solid: NDArray[np.bool_]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return the corners of all contours, one behind the other, and where each ends; see `trace`."""
    # Every closed border runs east somewhere: below a solid cell.
    starts = np.flatnonzero(solid[1:] & ~solid[:-1]) + solid.shape[1]
    corners, ends = _trace(solid, starts, _STEP_X, _STEP_Y, _LEFT_X, _LEFT_Y, _RIGHT_X, _RIGHT_Y)
    return corners, ends


@njit(cache=True, nogil=True)
def _convex(corners: NDArray[np.int32], ends: NDArray[np.int64], tolerance: float) -> NDArray[np.int32]:
    """Return the convex corners of all contours; see `convex_corners`."""
    found = np.empty((len(corners), 6), dtype=np.int32)
    count = 0
    begin = 0
    for end in ends:
        contour = corners[begin:end]
        begin = end
        polygon = contour[np.flatnonzero(_simplify(contour, tolerance))]
        n = len(polygon)
        for k in range(n):
            before, corner, after = polygon[k - 1], polygon[k], polygon[(k + 1) % n]
            arrived_x, arrived_y = np.int64(corner[0]) - before[0], np.int64(corner[1]) - before[1]
            leaves_x, leaves_y = np.int64(after[0]) - corner[0], np.int64(after[1]) - corner[1]
            if arrived_x * leaves_y - arrived_y * leaves_x > 0:
                for axis in range(2):
                    found[count, axis] = corner[axis]
                    found[count, 2 + axis] = before[axis]
                    found[count, 4 + axis] = after[axis]
                count += 1
    return found[:count].copy()


def convex_corners(solid: NDArray[np.bool_], tolerance: float) -> NDArray[np.int32]:
    """Return the convex corners of the simplified polygons around solid cells.

    Only these can be bends of a shortest path.

    Args:
        solid: as `trace` takes it.
        tolerance: of the simplification, cells: no corner that is left out lies farther from the polygon.

    Returns:
        Corner, the polygon's corner before it and the one after it, (x, y) each, int32, shape (n, 6).
    """
    corners: NDArray[np.int32] = _convex(*_borders(solid), tolerance)
    return corners


@njit(cache=True, nogil=True)
def thicken(cells: NDArray[np.int8], solid: NDArray[np.bool_], box: Box) -> None:
    """Bring up to date which cells are occupied or touch an occupied one.

    Args:
        cells: grid, int8; nothing in its outermost ring is occupied.
        solid: bool, shape of the grid, whose outermost ring is False.
        box: of the cells that have changed.
    """
    rows, columns = cells.shape
    for row in range(max(box[0] - 1, 1), min(box[1] + 2, rows - 1)):
        for column in range(max(box[2] - 1, 1), min(box[3] + 2, columns - 1)):
            touches = False
            for r in range(row - 1, row + 2):
                for c in range(column - 1, column + 2):
                    touches |= cells[r, c] == OCCUPIED
            solid[row, column] = touches
