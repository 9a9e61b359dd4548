"""Path lengths between some of the viewpoints, for tours that need few of them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from common.mapping.mapper import Mapper
from common.system.jit import njit


class Ways:
    """Path lengths between some nodes of a mapper's last update, looked up row by row.

    A search from every viewpoint of a large building would take a second, and a tour asks for the ways from its stops
    alone. What was not looked up yet is infinite, so that no move of a tour is made for it.

    Attributes:
        nodes: node numbers; other arrays and arguments count places in these, int64, shape (n,).
        lengths: metres, symmetric, float32, shape (n, n); infinite where no way is known.
    """

    def __init__(self, mapper: Mapper, nodes: NDArray[np.int64]) -> None:
        """Know of no way yet."""
        self.nodes = nodes
        self.lengths = np.full((len(nodes), len(nodes)), np.inf, dtype=np.float32)
        self._graph = _neighbours(len(mapper.viewpoints), mapper.edges, mapper.edge_lengths)
        self._known: set[int] = set()

    def look_up(self, places: Iterable[int]) -> None:
        """Make sure that the ways between some places and all others are known."""
        new = sorted({int(each) for each in places} - self._known)
        if new:
            _look_up(*self._graph, self.nodes, np.array(new), self.lengths)
            self._known.update(new)


@njit(cache=True, nogil=True)
def _neighbours(
    nodes: int, edges: NDArray[np.int64], lengths: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float32]]:
    """Return the edges by node: the first entry of each, shape (nodes + 1,), the neighbours and the edges' lengths."""
    pointer = np.zeros(nodes + 1, dtype=np.int64)
    for e in range(len(edges)):
        pointer[edges[e, 0] + 1] += 1
        pointer[edges[e, 1] + 1] += 1
    for node in range(nodes):
        pointer[node + 1] += pointer[node]
    place = pointer[:nodes].copy()
    neighbour = np.empty(2 * len(edges), dtype=np.int32)
    length = np.empty(2 * len(edges), dtype=np.float32)
    for e in range(len(edges)):
        for end in range(2):
            here = edges[e, end]
            neighbour[place[here]] = edges[e, 1 - end]
            length[place[here]] = lengths[e]
            place[here] += 1
    return pointer, neighbour, length


@njit(cache=True, nogil=True)
def _look_up(
    pointer: NDArray[np.int64],
    neighbour: NDArray[np.int32],
    length: NDArray[np.float32],
    nodes: NDArray[np.int64],
    places: NDArray[np.int64],
    lengths: NDArray[np.float32],
) -> None:
    """Write rows and columns of some places into `lengths`.

    Paths are found by corrected labels in a queue (Moore, 1959): edges are of similar length, so the queue's order is
    nearly that of the distances, and a heap, which makes it exact, takes three times as long.
    """
    count = len(pointer) - 1
    distance = np.empty(count, dtype=np.float32)
    waiting = np.zeros(count, dtype=np.bool_)
    queue = np.empty(count, dtype=np.int32)
    for place in places:
        distance[:] = np.inf
        distance[nodes[place]] = 0.0
        queue[0] = nodes[place]
        first, size = 0, 1
        while size:
            node = queue[first]
            first = first + 1 if first + 1 < count else 0
            size -= 1
            waiting[node] = False
            for k in range(pointer[node], pointer[node + 1]):
                there = neighbour[k]
                through = distance[node] + length[k]
                if through < distance[there]:
                    distance[there] = through
                    if not waiting[there]:
                        waiting[there] = True
                        last = first + size
                        queue[last if last < count else last - count] = there
                        size += 1
        for other in range(len(nodes)):
            lengths[place, other] = distance[nodes[other]]
            lengths[other, place] = distance[nodes[other]]
