"""A visibility graph of polygonal obstacles that is kept, and corrected only where the world has changed."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.mapping.raycast import SUBCELL_BITS
from common.mapping.sight import CLEAR, Box, blocker, may_touch
from common.planners.navigation.contours import convex_corners, thicken
from common.system.jit import njit

# What the simplification of a polygon cuts off at most, cells. Polygons are thickened by one cell, which closes the
# gaps between single returns of the lidar; less is cut off than that, so their edges are clear of occupied cells.
TOLERANCE: Final = 0.95


@njit(cache=True, nogil=True, inline="always")
def _touches(corner: NDArray[np.int32], x: int, y: int) -> bool:
    """Whether the line through a corner and a place touches the corner's polygon only there, or along its side."""
    dx, dy = x - corner[0], y - corner[1]
    before = dx * (corner[3] - corner[1]) - dy * (corner[2] - corner[0])
    after = dx * (corner[5] - corner[1]) - dy * (corner[4] - corner[0])
    return before * after >= 0


@njit(cache=True, nogil=True)
def _connect(
    cells: NDArray[np.int8],
    width: int,
    corners: NDArray[np.int32],
    old: NDArray[np.int64],
    were: NDArray[np.bool_],
    visible: NDArray[np.bool_],
    box: Box,
) -> int:
    """Test all pairs with a fresh corner and those whose line may touch a box; return how many were tested.

    Args:
        cells: grid, flat, int8.
        width: its cells per row.
        corners: see `VisibilityGraph`.
        old: number that each corner had before, -1 for a fresh one.
        were: pairs joined before, by these numbers.
        visible: receives the joined pairs, bool, shape (n, n).
        box: of cells that have changed.
    """
    tested = 0
    n = len(corners)
    for a in range(n):
        x0, y0 = corners[a, 0] << SUBCELL_BITS, corners[a, 1] << SUBCELL_BITS
        for b in range(a):
            x1, y1 = corners[b, 0] << SUBCELL_BITS, corners[b, 1] << SUBCELL_BITS
            if old[a] >= 0 and old[b] >= 0 and not may_touch(x0, y0, x1, y1, box):
                visible[a, b] = visible[b, a] = were[old[a], old[b]]
                continue
            clear = False
            if _touches(corners[a], corners[b, 0], corners[b, 1]) and _touches(
                corners[b], corners[a, 0], corners[a, 1]
            ):
                tested += 1
                clear = blocker(cells, width, x0, y0, x1, y1) == CLEAR
            visible[a, b] = visible[b, a] = clear
    return tested


def _numbers_of(corners: NDArray[np.int32], among: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the place of each corner among others, -1 where it is none of them; both int32, shape (n, 6)."""
    if not len(among):
        return np.full(len(corners), -1, dtype=np.int64)
    names, wanted = (np.ascontiguousarray(each).view(np.dtype((np.void, 24))).reshape(-1) for each in (among, corners))
    order = np.argsort(names)
    found = order[np.minimum(np.searchsorted(names, wanted, sorter=order), len(order) - 1)]
    return np.where(names[found] == wanted, found, -1)


@njit(cache=True, nogil=True)
def _seen_from(cells: NDArray[np.int8], width: int, corners: NDArray[np.int32], x: int, y: int) -> NDArray[np.bool_]:
    """Return which corners a place, subcells, sees."""
    seen = np.zeros(len(corners), dtype=np.bool_)
    for a in range(len(corners)):
        seen[a] = blocker(cells, width, x, y, corners[a, 0] << SUBCELL_BITS, corners[a, 1] << SUBCELL_BITS) == CLEAR
    return seen


@njit(cache=True, nogil=True)
def _shortest(
    corners: NDArray[np.int32],
    visible: NDArray[np.bool_],
    first: NDArray[np.float64],
    last: NDArray[np.float64],
) -> tuple[float, NDArray[np.int64]]:
    """Search a shortest path (Dijkstra, 1959) from first legs over corners to last legs, infinite where none is.

    Returns:
        Length and the corners of the path; infinite and none without a way.
    """
    n = len(corners)
    distance = first.copy()
    before = np.full(n, -1, dtype=np.int64)
    done = np.zeros(n, dtype=np.bool_)
    best, end = np.inf, -1
    while True:
        u = -1
        for k in range(n):
            if not done[k] and (u < 0 or distance[k] < distance[u]):
                u = k
        if u < 0 or not distance[u] < best:
            break
        done[u] = True
        if distance[u] + last[u] < best:
            best, end = distance[u] + last[u], u
        for k in range(n):
            if visible[u, k] and not done[k]:
                dx, dy = float(corners[k, 0] - corners[u, 0]), float(corners[k, 1] - corners[u, 1])
                further = distance[u] + np.sqrt(dx * dx + dy * dy)
                if further < distance[k]:
                    distance[k] = further
                    before[k] = u
    path = np.empty(n, dtype=np.int64)
    size = 0
    while end >= 0:
        path[size] = end
        size += 1
        end = before[end]
    return best, path[:size][::-1].copy()


class VisibilityGraph:
    """Convex corners of obstacles, and which of them see each other along the sides of their polygons.

    Two corners are joined when the segment between them touches no occupied cell and, at either end, passes the polygon
    on one side instead of running into it: other segments are no part of a shortest path.

    Attributes:
        corners: corner, the corner before it and the one after it, (x, y) in cells of the grid, int32, shape (n, 6).
        visible: joined pairs, bool, shape (n, n), symmetric.
        tested: segments tested by the last update.
        kept: corners that the last update kept from before.
    """

    def __init__(self) -> None:
        """Start without obstacles."""
        self.clear()

    def clear(self) -> None:
        """Forget everything, as when the grid has moved."""
        self.corners = np.empty((0, 6), dtype=np.int32)
        self.visible = np.empty((0, 0), dtype=np.bool_)
        self.tested = self.kept = 0
        self._solid = np.empty((0, 0), dtype=np.bool_)

    def update(self, possible: NDArray[np.int8], changed: Box) -> None:
        """Bring corners and pairs up to date.

        Args:
            possible: grid, int8, occupied or free; nothing near its border is occupied.
            changed: box of the cells that changed since the last update.
        """
        if self._solid.shape != possible.shape:
            self._solid = np.zeros(possible.shape, dtype=np.bool_)
            changed = (0, possible.shape[0] - 1, 0, possible.shape[1] - 1)
        thicken(possible, self._solid, changed)
        corners = convex_corners(self._solid, TOLERANCE)
        old = _numbers_of(corners, self.corners)
        visible = np.zeros((len(corners), len(corners)), dtype=np.bool_)
        flat = possible.reshape(-1)
        self.tested = int(_connect(flat, possible.shape[1], corners, old, self.visible, visible, changed))
        self.kept = int(np.count_nonzero(old >= 0))
        self.corners, self.visible = corners, visible

    def path(
        self, possible: NDArray[np.int8], start: tuple[int, int], goal: tuple[int, int]
    ) -> tuple[float, NDArray[np.int64]]:
        """Search a shortest path between two places, subcells.

        Returns:
            Length in cells, infinite without a way; and numbers of the corners on the way, none on a straight one.
        """
        if blocker(possible.reshape(-1), possible.shape[1], *start, *goal) == CLEAR:
            straight = np.hypot(start[0] - goal[0], start[1] - goal[1]) / (1 << SUBCELL_BITS)
            return float(straight), np.empty(0, dtype=np.int64)
        legs = []
        for x, y in (start, goal):
            seen = _seen_from(possible.reshape(-1), possible.shape[1], self.corners, x, y)
            gaps = np.hypot(self.corners[:, 0] - x / (1 << SUBCELL_BITS), self.corners[:, 1] - y / (1 << SUBCELL_BITS))
            legs.append(np.where(seen, gaps, np.inf))
        length, path = _shortest(self.corners, self.visible, legs[0], legs[1])
        return float(length), path
