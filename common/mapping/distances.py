"""Shortest paths over the edges of the viewpoint graph (Dijkstra, 1959)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.system.heap import pop, push
from common.system.jit import njit


@njit(cache=True, nogil=True)
def shortest_paths(
    pointer: NDArray[np.int64], neighbours: NDArray[np.int32], lengths: NDArray[np.float64], source: int, goal: int
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Compute the distance of every node from one node over edges, and where its shortest path comes from.

    Args:
        pointer: first neighbour of each node, then their number, int64, shape (n + 1,).
        neighbours: node numbers, int32, shape (entries,).
        lengths: of the edges to them, metres, float64, same shape.
        source: node number.
        goal: the search ends there, and what is farther away is not found; -1 for none.

    Returns:
        Distances in metres, float64, shape (n,), infinite where no path leads; and the node before each one on its
        path, int32, shape (n,), -1 for the source and for nodes without a path.
    """
    n = len(pointer) - 1
    distances = np.full(n, np.inf)
    before = np.full(n, -1, dtype=np.int32)
    done = np.zeros(n, dtype=np.bool_)
    heap_keys = np.empty(len(neighbours) + 1)
    heap = np.empty(len(neighbours) + 1, dtype=np.int32)
    distances[source] = 0.0
    heap_keys[0] = 0.0
    heap[0] = source
    size = 1
    while size:
        node = heap[0]
        size = pop(heap_keys, heap, size)
        if done[node]:
            continue
        done[node] = True
        if node == goal:
            break
        for k in range(pointer[node], pointer[node + 1]):
            there = neighbours[k]
            distance = distances[node] + lengths[k]
            if distance < distances[there]:
                distances[there] = distance
                before[there] = node
                size = push(heap_keys, heap, size, distance, there)
    return distances, before
