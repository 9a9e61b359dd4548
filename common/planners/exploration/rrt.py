"""Rapidly-exploring random trees in known clear space (LaValle, 1998), and the roadmap that grows like one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.mapping.cell_grid import CellGrid
from common.mapping.raycast import SUBCELLS
from common.mapping.sight import CLEAR, FREE, blocker
from common.planners.visibility import metres, subcells
from common.system.jit import njit


@njit(cache=True, nogil=True, inline="always")
def _nearest(points: NDArray[np.int64], count: int, x: int, y: int) -> tuple[int, float]:
    """Return the nearest of the first `count` points and its squared distance, subcells."""
    best, nearest = np.inf, -1
    for k in range(count):
        dx, dy = np.float64(points[k, 0] - x), np.float64(points[k, 1] - y)
        if dx * dx + dy * dy < best:
            best, nearest = dx * dx + dy * dy, k
    return nearest, best


@njit(cache=True, nogil=True)
def _extend(
    cells: NDArray[np.int8],
    width: int,
    points: NDArray[np.int64],
    parents: NDArray[np.int64],
    depths: NDArray[np.float64],
    count: int,
    samples: NDArray[np.int64],
    step: float,
    spread: float,
) -> int:
    """Extend a tree by samples until they or the room in its arrays are used up; return its number of nodes.

    Args:
        cells: padded grid, flat, int8.
        width: its cells per row.
        points: nodes, subcells, shape (capacity, 2); the first `count` are given.
        parents: number of each node's parent, -1 for the root.
        depths: length of the way from the root, subcells.
        count: nodes so far.
        samples: where to extend to, subcells, inside the grid, shape (n, 2).
        step: longest edge, subcells.
        spread: a node nearer than this to another one is left out, subcells.
    """
    for s in range(len(samples)):
        if count == len(points):
            break
        x, y = samples[s, 0], samples[s, 1]
        parent, squared = _nearest(points, count, x, y)
        length = np.sqrt(squared)
        if length > step:
            x = points[parent, 0] + np.int64((x - points[parent, 0]) * (step / length))
            y = points[parent, 1] + np.int64((y - points[parent, 1]) * (step / length))
            length = np.hypot(np.float64(x - points[parent, 0]), np.float64(y - points[parent, 1]))
            _, squared = _nearest(points, count, x, y)
        if squared < spread * spread or blocker(cells, width, points[parent, 0], points[parent, 1], x, y) != CLEAR:
            continue
        points[count, 0], points[count, 1] = x, y
        parents[count] = parent
        depths[count] = depths[parent] + length
        count += 1
    return count


class Tree:
    """A tree that is rooted where the robot stands.

    Attributes:
        points: nodes, metres, shape (n, 2), the root first.
        parents: number of each node's parent, -1 for the root.
        depths: length of the way from the root, metres.
    """

    def __init__(self, root: tuple[float, float]) -> None:
        """Start with the root alone, metres."""
        self.points = np.array([root], dtype=np.float64)
        self.parents = np.array([-1], dtype=np.int64)
        self.depths = np.zeros(1)

    def append(self, point: tuple[float, float], parent: int) -> int:
        """Add a node whose edge is known to be free, and return its number."""
        length = np.hypot(*(np.array(point) - self.points[parent]))
        self.points = np.vstack([self.points, point])
        self.parents = np.append(self.parents, parent)
        self.depths = np.append(self.depths, self.depths[parent] + length)
        return len(self.points) - 1

    def graft(self, points: NDArray[np.float64]) -> None:
        """Add places, metres, shape (m, 2), that the tree may grow from but that have no place in it themselves."""
        self.points = np.vstack([self.points, points])
        self.parents = np.append(self.parents, np.full(len(points), -1))
        self.depths = np.append(self.depths, np.zeros(len(points)))

    def extend(
        self, clear: CellGrid, samples: NDArray[np.float64], *, capacity: int, step: float, spread: float
    ) -> None:
        """Extend the tree towards samples through cells that are clear.

        Args:
            clear: where the robot fits, see `Mapper.clear`.
            samples: metres, inside the grid, shape (n, 2).
            capacity: nodes at most.
            step: longest edge, metres.
            spread: least distance between nodes, metres.
        """
        count = len(self.points)
        capacity = max(capacity, count)
        points = np.empty((capacity, 2), dtype=np.int64)
        parents = np.full(capacity, -1, dtype=np.int64)
        depths = np.zeros(capacity)
        scale = SUBCELLS / clear.resolution
        points[:count] = subcells(clear, self.points)
        parents[:count] = self.parents
        depths[:count] = self.depths * scale
        padded = clear.padded
        size = _extend(
            padded.reshape(-1),
            padded.shape[1],
            points,
            parents,
            depths,
            count,
            subcells(clear, samples),
            step * scale,
            spread * scale,
        )
        # Nodes that were there keep their exact place.
        self.points = np.vstack([self.points, metres(clear, points[count:size])])
        self.parents = parents[:size]
        self.depths = np.append(self.depths, depths[count:size] / scale)

    def branch(self, node: int) -> list[int]:
        """Return the nodes from the root, excluded, to a node."""
        nodes = []
        while self.parents[node] >= 0:
            nodes.append(node)
            node = int(self.parents[node])
        return nodes[::-1]


def free_box(clear: CellGrid) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return the lower left and upper right corner of the box around all clear cells, metres; None without any."""
    free = clear.padded[1:-1, 1:-1] == FREE
    rows, columns = np.flatnonzero(free.any(axis=1)), np.flatnonzero(free.any(axis=0))
    if not len(rows):
        return None
    low = np.array([columns[0], rows[0]]) * clear.resolution + np.array(clear.origin)
    high = np.array([columns[-1] + 1, rows[-1] + 1]) * clear.resolution + np.array(clear.origin)
    return low, high - 1e-6 * clear.resolution
