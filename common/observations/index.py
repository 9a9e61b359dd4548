"""The graphs of a batch as one table of neighbours: from lists of edges to what kernels and networks walk along."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.observations.observation import NEIGHBOUR_COUNT, STEP_UNITS, ObservationBatch
from common.system.jit import njit

SELF_SLOT = -2
LINK_SLOT = -1
EXTRA_SLOTS = 2


@dataclass(frozen=True, slots=True, eq=False)
class NeighbourTable:
    """Who is beside whom in a batch of k observations, targets included.

    A row has W slots for neighbours, ascending by node number and without gaps, then one for the node itself
    (`SELF_SLOT`), and one for the target where the node is linked to it (`LINK_SLOT`). A target has its links in the
    first W. W is the largest number of neighbours in the batch, 20 at least.

    Attributes:
        rows: batch-global row of each neighbour, -1 where absent, int32, shape (nodes, W + 2).
        lengths: length of the way there in lattice steps, 0 where absent, float64, shape (nodes, W + 2).
        node_ptr: first row of each observation, then the number of rows, int64, shape (k + 1,).
        extremes: shortest and longest way of each observation, inf and 0 where it has none, float64, shape (k, 2).
    """

    rows: NDArray[np.int32]
    lengths: NDArray[np.float64]
    node_ptr: NDArray[np.int64]
    extremes: NDArray[np.float64]


def neighbour_table(batch: ObservationBatch) -> NeighbourTable:
    """Build the table of a valid batch (what comes over the bus is checked when it is decoded)."""
    node_ptr = np.zeros(len(batch) + 1, dtype=np.int64)
    np.cumsum(batch.count + batch.has_target, out=node_ptr[1:])
    most = _most_neighbours(batch.count, batch.edge_count, batch.degree, batch.neighbours)
    shape = (int(node_ptr[-1]), max(most, NEIGHBOUR_COUNT) + EXTRA_SLOTS)
    rows = np.full(shape, -1, dtype=np.int32)
    lengths = np.zeros(shape)
    extremes = np.empty((len(batch), 2))
    _fill_edges(
        batch.count,
        batch.offsets,
        batch.degree,
        batch.neighbours,
        batch.bent,
        batch.bent_length,
        batch.bent_count,
        node_ptr,
        rows,
        lengths,
        extremes,
    )
    _fill_links(
        batch.count,
        batch.offsets,
        batch.has_target,
        batch.target_offset,
        batch.link_count,
        batch.target_links,
        node_ptr,
        rows,
        lengths,
        extremes,
    )
    return NeighbourTable(rows, lengths, node_ptr, extremes)


def waypoint_counts(batch: ObservationBatch) -> NDArray[np.int32]:
    """Number of waypoints of each observation, as `Observation.waypoint_nodes` lists them, int32, shape (k,)."""
    return _count_waypoints(
        batch.count,
        batch.degree,
        batch.edge_count,
        batch.neighbours,
        batch.robot,
        batch.target_known,
        batch.link_count,
        batch.target_links,
    )


@njit(cache=True, nogil=True)
def _most_neighbours(
    count: NDArray[np.int32],
    edge_count: NDArray[np.int32],
    degree: NDArray[np.uint8],
    neighbours: NDArray[np.uint16],
) -> int:
    """Return the largest number of neighbours, higher and lower ones, of a viewpoint."""
    most = 0
    first = 0
    edge = 0
    total = np.empty(count.max(), dtype=np.int32)
    for g in range(len(count)):
        for i in range(count[g]):
            total[i] = degree[first + i]
        for e in range(edge, edge + edge_count[g]):
            total[neighbours[e]] += 1
        for i in range(count[g]):
            most = max(most, total[i])
        first += count[g]
        edge += edge_count[g]
    return most


@njit(cache=True, nogil=True)
def _fill_edges(
    count: NDArray[np.int32],
    offsets: NDArray[np.int16],
    degree: NDArray[np.uint8],
    neighbours: NDArray[np.uint16],
    bent: NDArray[np.uint32],
    bent_length: NDArray[np.float32],
    bent_count: NDArray[np.int32],
    node_ptr: NDArray[np.int64],
    rows: NDArray[np.int32],
    lengths: NDArray[np.float64],
    extremes: NDArray[np.float64],
) -> None:
    """Write every edge into the rows of both its ends.

    A viewpoint's lower neighbours come before it in the sweep, in ascending order, so each row ends up ascending.
    Places are unsigned: numba would ask of signed ones whether they count from the end, at twice the time of it all.
    """
    view = 0
    edge = 0
    b = 0
    for g in range(len(count)):
        n, first, first_edge = count[g], node_ptr[g], edge
        places = offsets[view : view + n]
        own_rows, own_lengths = rows[first : first + n], lengths[first : first + n]
        last_bent = b + bent_count[g]
        next_bent = np.int64(bent[b]) if b < last_bent else np.int64(-1)
        filled = np.zeros(n, dtype=np.uint32)
        shortest, longest = np.inf, 0.0
        for node in range(n):
            i = np.uint64(node)
            own_rows[i, SELF_SLOT] = first + node
            x, y = np.int64(places[i, 0]), np.int64(places[i, 1])
            for e in range(edge, edge + degree[view + node]):
                j = np.uint64(neighbours[np.uint64(e)])
                if e - first_edge == next_bent:
                    length = float(bent_length[b])
                    b += 1
                    next_bent = np.int64(bent[b]) if b < last_bent else np.int64(-1)
                else:
                    dx, dy = np.int64(places[j, 0]) - x, np.int64(places[j, 1]) - y
                    length = math.sqrt(float(dx * dx + dy * dy)) / STEP_UNITS
                shortest, longest = min(shortest, length), max(longest, length)
                for here, there in ((i, j), (j, i)):
                    slot = np.uint64(filled[here])
                    own_rows[here, slot] = first + np.int64(there)
                    own_lengths[here, slot] = length
                    filled[here] = slot + np.uint64(1)
            edge += degree[view + node]
        extremes[g, 0] = shortest
        extremes[g, 1] = longest
        view += n


@njit(cache=True, nogil=True)
def _fill_links(
    count: NDArray[np.int32],
    offsets: NDArray[np.int16],
    has_target: NDArray[np.bool_],
    target_offset: NDArray[np.float32],
    link_count: NDArray[np.int32],
    target_links: NDArray[np.uint16],
    node_ptr: NDArray[np.int64],
    rows: NDArray[np.int32],
    lengths: NDArray[np.float64],
    extremes: NDArray[np.float64],
) -> None:
    view = 0
    link = 0
    for g in range(len(count)):
        if has_target[g]:
            first = node_ptr[g]
            target = first + count[g]
            rows[target, SELF_SLOT] = target
            for slot in range(link_count[g]):
                i = np.int64(target_links[link + slot])
                dx = offsets[view + i, 0] / STEP_UNITS - target_offset[g, 0]
                dy = offsets[view + i, 1] / STEP_UNITS - target_offset[g, 1]
                rows[target, slot] = first + i
                rows[first + i, LINK_SLOT] = target
                length = math.hypot(dx, dy)
                lengths[target, slot] = lengths[first + i, LINK_SLOT] = length
                extremes[g, 0] = min(extremes[g, 0], length)
                extremes[g, 1] = max(extremes[g, 1], length)
        view += count[g]
        link += link_count[g]


@njit(cache=True, nogil=True)
def _count_waypoints(
    count: NDArray[np.int32],
    degree: NDArray[np.uint8],
    edge_count: NDArray[np.int32],
    neighbours: NDArray[np.uint16],
    robot: NDArray[np.int32],
    target_known: NDArray[np.bool_],
    link_count: NDArray[np.int32],
    links: NDArray[np.uint16],
) -> NDArray[np.int32]:
    waypoints = np.zeros(len(robot), dtype=np.int32)
    first = 0
    edge = 0
    link = 0
    for g in range(len(robot)):
        # Of the edges' own type, so that they are compared many at a time.
        here = np.uint16(robot[g])
        found = np.int32(degree[first + robot[g]])
        for other in neighbours[edge : edge + edge_count[g]]:
            found += np.int32(other == here)
        if target_known[g]:
            for other in links[link : link + link_count[g]]:
                found += np.int32(other == here)
        waypoints[g] = found
        first += count[g]
        edge += edge_count[g]
        link += link_count[g]
    return waypoints
