"""Shortest paths over the graphs of observations, in compiled kernels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.observations.index import NeighbourTable
from common.observations.observation import ObservationBatch
from common.system.heap import pop, push
from common.system.jit import njit

TIE: Final = 1e-6
"""Two path lengths that differ by less are one length: sums of the same edges in different orders."""
# Buckets are this much narrower than the shortest way, so that no sum's rounding, nor a tie, leads from a bucket into
# itself; ways this much longer than TIE allow that.
_NARROWER = 0.999
_SHORTEST = 0.01
# Beyond this many, clearing and searching the buckets takes as long as a heap.
_MOST_BUCKETS = 1024


@dataclass(frozen=True, slots=True, eq=False)
class RobotPaths:
    """Shortest paths from the robot of each of k observations; no path leads through a target.

    Attributes:
        distance: length of the path to each node in lattice steps, inf where there is none, float64, shape (nodes,).
        order: nodes of each observation that can be reached, from the first row of its nodes on, such that every node
            comes behind those on its shortest paths, int64, shape (nodes,).
        reached: how many those are, int64, shape (k,).
    """

    distance: NDArray[np.float64]
    order: NDArray[np.int64]
    reached: NDArray[np.int64]


def robot_paths(batch: ObservationBatch, table: NeighbourTable) -> RobotPaths:
    """Find the shortest paths from the robots of a batch."""
    nodes = len(table.rows)
    distance, order = np.full(nodes, np.inf), np.empty(nodes, dtype=np.int64)
    reached = np.empty(len(batch), dtype=np.int64)
    _fill_robot_paths(
        table.rows,
        table.lengths,
        table.node_ptr,
        table.extremes,
        batch.robot,
        batch.has_target,
        distance,
        order,
        reached,
    )
    return RobotPaths(distance, order, reached)


def paths_toward(
    batch: ObservationBatch, table: NeighbourTable, paths: RobotPaths, wanted: NDArray[np.bool_]
) -> NDArray[np.uint64]:
    """Say with which of the robot's neighbours the shortest paths to each node begin.

    Args:
        batch: k observations.
        table: their neighbours.
        paths: from their robots.
        wanted: nodes to tell about, with all that lie on the shortest paths to them, shape (nodes,).

    Returns:
        Bit s of a node is set when a shortest path (any, if several) from the robot to it begins with the neighbour in
        slot s of the robot's row, or s + 64, and so on; 0 where no path leads and where nothing is
        wanted, uint64, shape (nodes,).
    """
    return _first_steps(
        table.rows,
        table.lengths,
        table.node_ptr,
        batch.robot,
        batch.has_target,
        paths.distance,
        paths.order,
        paths.reached,
        wanted,
    )


@njit(cache=True, nogil=True)
def shortest_paths(
    neighbours: NDArray[np.int32],
    lengths: NDArray[np.float64],
    extremes: NDArray[np.float64],
    first: int,
    target: int,
    distance: NDArray[np.float64],
    order: NDArray[np.int64],
) -> int:
    """Find shortest paths from all nodes of finite ``distance``, and fill in the others.

    Distances are the least sums of lengths, added from the source on, to the last bit, whichever queue finds them.

    Args:
        neighbours: of one observation in a `NeighbourTable`, shape (nodes, W + 2).
        lengths: likewise, lattice steps.
        extremes: likewise, shape (2,); no source has a ``distance`` beyond the longest.
        first: number of its first node in the table.
        target: node that no path leads through; -1 for none.
        distance: of each node, inf where it is to be found, float64, shape (nodes,); changed in place.
        order: filled with the nodes that can be reached, each behind those on its shortest paths, shape (nodes,).

    Returns:
        How many can be reached.
    """
    width = extremes[0] * _NARROWER
    if _SHORTEST <= extremes[0] < np.inf and extremes[1] < (_MOST_BUCKETS - 2) * width:
        buckets = int(extremes[1] / width) + 2
        return _by_buckets(neighbours, lengths, width, buckets, first, target, distance, order)
    return _by_heap(neighbours, lengths, first, target, distance, order)


@njit(cache=True, nogil=True)
def _by_buckets(
    neighbours: NDArray[np.int32],
    lengths: NDArray[np.float64],
    width: float,
    buckets: int,
    first: int,
    target: int,
    distance: NDArray[np.float64],
    order: NDArray[np.int64],
) -> int:
    """Dial's algorithm: buckets narrower than every edge, whose nodes therefore cannot shorten each other's paths.

    The nodes in the queue lie at most one edge apart, so the buckets are used again in turn. A node is queued anew
    whenever its path becomes shorter; only the first of its entries counts.
    """
    nodes, slots = neighbours.shape
    scale = 1.0 / width
    newest = np.full(buckets, -1, dtype=np.int32)
    # Entries of the queue: their node, and the entry below in the same bucket. There is one for an edge at most, but
    # few more than nodes; memory that is not written to costs nothing.
    items = np.empty(nodes * slots, dtype=np.int32)
    below = np.empty(nodes * slots, dtype=np.int32)
    entries = 0
    for source in range(nodes):
        if distance[source] < np.inf:
            bucket = np.uint64(distance[source] * scale) % np.uint64(buckets)
            items[entries] = source
            below[entries] = newest[bucket]
            newest[bucket] = entries
            entries += 1
    waiting = entries
    done = np.zeros(nodes, dtype=np.bool_)
    settled = 0
    at = np.uint64(0)
    while waiting > 0:
        while newest[at] < 0:
            at += np.uint64(1)
            if at == np.uint64(buckets):
                at = np.uint64(0)
        entry = np.uint64(newest[at])
        newest[at] = below[entry]
        waiting -= 1
        i = np.uint64(items[entry])
        if done[i]:
            continue
        done[i] = True
        order[settled] = i
        settled += 1
        if np.int64(i) == target:
            continue
        for slot in range(slots):
            other = neighbours[i, np.uint64(slot)] - first
            if other < 0:
                continue
            j = np.uint64(other)
            length = distance[i] + lengths[i, np.uint64(slot)]
            if length < distance[j]:
                distance[j] = length
                bucket = np.uint64(length * scale) % np.uint64(buckets)
                items[entries] = other
                below[entries] = newest[bucket]
                newest[bucket] = entries
                entries += 1
                waiting += 1
    return settled


@njit(cache=True, nogil=True)
def _by_heap(
    neighbours: NDArray[np.int32],
    lengths: NDArray[np.float64],
    first: int,
    target: int,
    distance: NDArray[np.float64],
    order: NDArray[np.int64],
) -> int:
    """Dijkstra's algorithm, for graphs with edges of very different lengths."""
    nodes, slots = neighbours.shape
    keys = np.empty(nodes * slots)
    items = np.empty(nodes * slots, dtype=np.int64)
    size = 0
    for i in range(nodes):
        if distance[i] < np.inf:
            size = push(keys, items, size, distance[i], i)
    done = np.zeros(nodes, dtype=np.bool_)
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
    return settled


@njit(cache=True, nogil=True)
def _fill_robot_paths(
    neighbours: NDArray[np.int32],
    lengths: NDArray[np.float64],
    node_ptr: NDArray[np.int64],
    extremes: NDArray[np.float64],
    robot: NDArray[np.int32],
    has_target: NDArray[np.bool_],
    distance: NDArray[np.float64],
    order: NDArray[np.int64],
    reached: NDArray[np.int64],
) -> None:
    for g in range(len(robot)):
        first, last = node_ptr[g], node_ptr[g + 1]
        target = last - first - 1 if has_target[g] else np.int64(-1)
        distance[first + robot[g]] = 0.0
        reached[g] = shortest_paths(
            neighbours[first:last],
            lengths[first:last],
            extremes[g],
            first,
            target,
            distance[first:last],
            order[first:last],
        )


@njit(cache=True, nogil=True)
def _first_steps(
    neighbours: NDArray[np.int32],
    lengths: NDArray[np.float64],
    node_ptr: NDArray[np.int64],
    robot: NDArray[np.int32],
    has_target: NDArray[np.bool_],
    distances: NDArray[np.float64],
    orders: NDArray[np.int64],
    reached: NDArray[np.int64],
    wanted: NDArray[np.bool_],
) -> NDArray[np.uint64]:
    bits = np.zeros(len(neighbours), dtype=np.uint64)
    slots = neighbours.shape[1]
    for g in range(len(robot)):
        first, last = node_ptr[g], node_ptr[g + 1]
        target = last - first - 1 if has_target[g] else np.int64(-1)
        here = np.int64(robot[g])
        distance = distances[first:last]
        for node in orders[first : first + reached[g]]:
            if node == here or not wanted[first + node]:
                continue
            j = np.uint64(first + node)
            found = np.uint64(0)
            for slot in range(slots):
                i = np.int64(neighbours[j, np.uint64(slot)]) - first
                if i < 0 or i in (node, target):
                    continue
                if abs(distance[np.uint64(i)] + lengths[j, np.uint64(slot)] - distance[np.uint64(node)]) >= TIE:
                    continue
                if i != here:
                    found |= bits[np.uint64(first + i)]
                    continue
                for own in range(slots):
                    if neighbours[first + here, own] == first + node:
                        found |= np.uint64(1) << np.uint64(own % 64)
            bits[j] = found
    return bits
