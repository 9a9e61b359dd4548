"""Shortest paths over the edges of the viewpoint graph (Dijkstra, 1959)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.heap import pop, push
from common.jit import njit
from common.observation import NEIGHBOUR_COUNT, NEIGHBOUR_OFFSETS

# Length of each neighbour offset in lattice steps.
OFFSET_LENGTHS: NDArray[np.float64] = np.hypot(
    NEIGHBOUR_OFFSETS[:, 0].astype(np.float64), NEIGHBOUR_OFFSETS[:, 1].astype(np.float64)
)


@njit(cache=True, nogil=True)
def shortest_paths(
    edges: NDArray[np.uint32],
    offsets: NDArray[np.int16],
    lengths: NDArray[np.float64],
    order: NDArray[np.int32],
    numbers: NDArray[np.int32],
    source: int,
    spacing: float,
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Compute the distance of every node from one node over edges, and where its shortest path comes from.

    Args:
        edges: 20-bit masks of the whole lattice, uint32, shape (rows, columns).
        offsets: the 20 neighbour offsets (dx, dy).
        lengths: their lengths in lattice steps.
        order: flat lattice index of each node, int32, shape (n,).
        numbers: node number of each lattice point or -1, int32, flat.
        source: node number.
        spacing: metres.

    Returns:
        Distances in metres, float64, shape (n,), infinite where no path leads; and the node before each one on its
        path, int32, shape (n,), -1 for the source and for nodes without a path.
    """
    columns = edges.shape[1]
    n = len(order)
    distances = np.full(n, np.inf)
    before = np.full(n, -1, dtype=np.int32)
    done = np.zeros(n, dtype=np.bool_)
    heap_keys = np.empty(n * NEIGHBOUR_COUNT + 1)
    heap = np.empty(n * NEIGHBOUR_COUNT + 1, dtype=np.int32)
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
        here = order[node]
        mask = edges[here // columns, here % columns]
        for k in range(NEIGHBOUR_COUNT):
            if (mask >> np.uint32(k)) & np.uint32(1):
                there = numbers[here + offsets[k, 1] * columns + offsets[k, 0]]
                distance = distances[node] + lengths[k] * spacing
                if distance < distances[there]:
                    distances[there] = distance
                    before[there] = node
                    size = push(heap_keys, heap, size, distance, there)
    return distances, before
