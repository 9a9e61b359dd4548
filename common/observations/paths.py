"""Shortest paths over the graph of an observation, in compiled kernels."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.system.heap import pop, push
from common.system.jit import njit

TIE: Final = 1e-6
"""Two path lengths that differ by less are one length: sums of the same edges in different orders."""


@njit(cache=True, nogil=True)
def paths_toward(
    neighbours: NDArray[np.int32],
    lengths: NDArray[np.float64],
    node_ptr: NDArray[np.int64],
    robot: NDArray[np.int32],
    has_target: NDArray[np.bool_],
) -> NDArray[np.uint64]:
    """Say with which of the robot's neighbours the shortest paths to each node begin.

    Args:
        neighbours: of a `NeighbourTable`, shape (nodes, W + 2).
        lengths: likewise.
        node_ptr: likewise, shape (k + 1,).
        robot: node number of the robot's viewpoint, shape (k,).
        has_target: whether the last node is the target, through which no path leads, shape (k,).

    Returns:
        Bit s of a node is set when a shortest path (any, if several) from the robot to it begins with the neighbour in
        slot s of the robot's row, or s + 64, and so on; 0 where no path leads, uint64, shape (nodes,).
    """
    bits = np.zeros(len(neighbours), dtype=np.uint64)
    slots = neighbours.shape[1]
    for g in range(len(robot)):
        first, last = node_ptr[g], node_ptr[g + 1]
        target = last - first - 1 if has_target[g] else np.int64(-1)
        here = np.int64(robot[g])
        distance = np.full(last - first, np.inf)
        distance[here] = 0.0
        order = shortest_paths(neighbours[first:last], lengths[first:last], first, target, distance)
        for j in order:
            if j == here:
                continue
            for slot in range(slots):
                i = neighbours[first + j, slot] - first
                if i < 0 or i in (j, target):
                    continue
                if abs(distance[i] + lengths[first + j, slot] - distance[j]) >= TIE:
                    continue
                if i != here:
                    bits[first + j] |= bits[first + i]
                    continue
                for own in range(slots):
                    if neighbours[first + here, own] == first + j:
                        bits[first + j] |= np.uint64(1) << np.uint64(own % 64)
    return bits


@njit(cache=True, nogil=True)
def shortest_paths(
    neighbours: NDArray[np.int32],
    lengths: NDArray[np.float64],
    first: int,
    target: int,
    distance: NDArray[np.float64],
) -> NDArray[np.int64]:
    """Run Dijkstra from all nodes of finite ``distance``, and fill in the others.

    Args:
        neighbours: of one observation in a `NeighbourTable`, shape (nodes, W + 2).
        lengths: likewise, lattice steps.
        first: number of its first node in the table.
        target: node that no path leads through; -1 for none.
        distance: of each node, inf where it is to be found, float64, shape (nodes,); changed in place.

    Returns:
        The nodes that can be reached, in order of distance, int64.
    """
    nodes, slots = neighbours.shape
    capacity = nodes + 1
    for i in range(nodes):
        for slot in range(slots):
            capacity += neighbours[i, slot] >= 0
    keys = np.empty(capacity)
    items = np.empty(capacity, dtype=np.int64)
    size = 0
    for i in range(nodes):
        if distance[i] < np.inf:
            size = push(keys, items, size, distance[i], i)
    done = np.zeros(nodes, dtype=np.bool_)
    order = np.empty(nodes, dtype=np.int64)
    settled = 0
    while size > 0:
        i = items[0]
        size = pop(keys, items, size)
        if done[i]:
            continue
        done[i] = True
        order[settled] = i
        settled += 1
        if i == target:
            continue
        for slot in range(slots):
            j = neighbours[i, slot] - first
            if j < 0 or done[j]:
                continue
            length = distance[i] + lengths[i, slot]
            if length < distance[j]:
                distance[j] = length
                size = push(keys, items, size, length, j)
    return order[:settled]
