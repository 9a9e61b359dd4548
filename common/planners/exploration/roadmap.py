"""A roadmap: places in known clear space, joined in line of sight, that grows where a random tree would."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.mapping.cell_grid import CellGrid
from common.mapping.raycast import SUBCELLS
from common.mapping.sight import CLEAR, blocker
from common.planners.visibility import subcells
from common.system.jit import njit


@njit(cache=True, nogil=True)
def _join(
    cells: NDArray[np.int8],
    width: int,
    points: NDArray[np.int64],
    first: int,
    lengths: NDArray[np.float64],
    reach: float,
    scale: float,
) -> None:
    """Fill in the edges of the points from number `first` on: all pairs in line of sight within `reach`, metres.

    The points are in subcells, `scale` of them to the metre.
    """
    for a in range(first, len(points)):
        for b in range(a):
            dx, dy = np.float64(points[a, 0] - points[b, 0]), np.float64(points[a, 1] - points[b, 1])
            length = np.hypot(dx, dy) / scale
            free = (
                length <= reach
                and blocker(cells, width, points[a, 0], points[a, 1], points[b, 0], points[b, 1]) == CLEAR
            )
            lengths[a, b] = lengths[b, a] = length if free else np.inf
        lengths[a, a] = 0.0


@njit(cache=True, nogil=True)
def _dijkstra(lengths: NDArray[np.float64], source: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return distances from a node and the node before each one, -1 for the source and where no way leads."""
    count = len(lengths)
    distances = np.full(count, np.inf)
    before = np.full(count, -1, dtype=np.int64)
    done = np.zeros(count, dtype=np.bool_)
    distances[source] = 0.0
    while True:
        node = -1
        for k in range(count):
            if not done[k] and distances[k] < np.inf and (node < 0 or distances[k] < distances[node]):
                node = k
        if node < 0:
            return distances, before
        done[node] = True
        for k in range(count):
            if distances[node] + lengths[node, k] < distances[k]:
                distances[k] = distances[node] + lengths[node, k]
                before[k] = node


class Roadmap:
    """Places and the straight free ways between them.

    Attributes:
        points: metres, shape (n, 2).
        lengths: of the edges, metres, infinite where there is none, shape (n, n), symmetric.
    """

    def __init__(self, reach: float) -> None:
        """Start empty; `reach` is the longest edge, metres."""
        self._reach = reach
        self.points = np.empty((0, 2))
        self.lengths = np.empty((0, 0))

    def __len__(self) -> int:
        return len(self.points)

    def add(self, clear: CellGrid, points: NDArray[np.float64]) -> None:
        """Add places in clear cells, metres, shape (m, 2), and join them with all in reach and in sight."""
        first, count = len(self.points), len(self.points) + len(points)
        self.points = np.vstack([self.points, points])
        lengths = np.full((count, count), np.inf)
        lengths[:first, :first] = self.lengths
        self.lengths = lengths
        padded = clear.padded
        scale = SUBCELLS / clear.resolution
        places = subcells(clear, self.points)
        # A millionth of rounding must not cut off what is exactly in reach.
        _join(padded.reshape(-1), padded.shape[1], places, first, lengths, self._reach * (1.0 + 1e-6), scale)

    def add_ways(
        self,
        clear: CellGrid,
        points: NDArray[np.float64],
        before: NDArray[np.int64],
        known: list[int],
        spread: float,
    ) -> None:
        """Add places of ways sparsely, without tearing the ways apart.

        A place is left out only for another one that is nearer than `spread`, sees it and is joined to what stands for
        the place before it: a neighbour behind a wall is nearest to many a place, and leads nowhere.

        Args:
            clear: where the robot fits, see `Mapper.clear`.
            points: places of the roadmap that the ways are from, metres, shape (n, 2).
            before: the place before each one on its way, -1 for a start.
            known: the places to add, each after the one before it.
            spread: metres, at most the longest edge.
        """
        low, high = points[known].min(axis=0) - self._reach, points[known].max(axis=0) + self._reach
        near = self.points[((self.points >= low) & (self.points <= high)).all(axis=1)]
        both = Roadmap(self._reach)
        both.add(clear, np.vstack([near, points[known]]))
        kept = np.arange(len(both)) < len(near)
        own = {node: len(near) + k for k, node in enumerate(known)}
        stands: dict[int, int] = {}
        for node in known:
            lengths = both.lengths[own[node]]
            last = stands.get(int(before[node]))
            close = np.flatnonzero(kept & (lengths < spread))
            if last is not None:
                close = close[np.isfinite(both.lengths[last, close])]
            if len(close):
                stands[node] = int(close[np.argmin(lengths[close])])
                continue
            if last is not None and np.isinf(lengths[last]):
                kept[own[int(before[node])]] = True
            kept[own[node]] = True
            stands[node] = own[node]
        self.add(clear, both.points[len(near) :][kept[len(near) :]])

    def recheck(self, clear: CellGrid) -> None:
        """Connect all places again: edges no longer known to be free go, those that have become free are added."""
        points, self.points, self.lengths = self.points, np.empty((0, 2)), np.empty((0, 0))
        self.add(clear, points)

    def keep(self, nodes: NDArray[np.int64]) -> None:
        """Drop all places but these; they are renumbered in this order."""
        self.points = self.points[nodes]
        self.lengths = np.ascontiguousarray(self.lengths[np.ix_(nodes, nodes)])

    def shortest(self, source: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return the distance of every place from one, metres, infinite without a way, and the place before it."""
        distances, before = _dijkstra(self.lengths, source)
        return distances, before


def trace(before: NDArray[np.int64], node: int) -> list[int]:
    """Return the way to a node, both ends included, from what `Roadmap.shortest` gave."""
    way = [node]
    while before[way[-1]] >= 0:
        way.append(int(before[way[-1]]))
    return way[::-1]
