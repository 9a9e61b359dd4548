"""Copy sampled observations out of the replay buffer's ring, in machine code and without the GIL."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.jit import njit
from common.observation import ObservationBatch


@njit(cache=True, nogil=True)
def gather_viewpoints(
    start: NDArray[np.int64],
    count: NDArray[np.int32],
    ring_offsets: NDArray[np.int16],
    ring_utility: NDArray[np.uint16],
    ring_visited: NDArray[np.bool_],
    ring_beacon: NDArray[np.bool_],
    ring_edges: NDArray[np.uint32],
    offsets: NDArray[np.int16],
    utility: NDArray[np.uint16],
    visited: NDArray[np.bool_],
    beacon: NDArray[np.bool_],
    edges: NDArray[np.uint32],
) -> None:
    """Fill the output columns with the rows ``start[i] .. start[i] + count[i]``, one observation behind the other."""
    at = 0
    for i in range(len(start)):
        first = start[i]
        rows = count[i]
        offsets[at : at + rows] = ring_offsets[first : first + rows]
        utility[at : at + rows] = ring_utility[first : first + rows]
        visited[at : at + rows] = ring_visited[first : first + rows]
        beacon[at : at + rows] = ring_beacon[first : first + rows]
        edges[at : at + rows] = ring_edges[first : first + rows]
        at += rows


def waypoint_counts(batch: ObservationBatch) -> NDArray[np.int32]:
    """Number of waypoints of each observation, as `Observation.waypoint_nodes` lists them, int32, shape (k,)."""
    first = np.concatenate(([0], np.cumsum(batch.count, dtype=np.int64)))
    link_first = np.concatenate(([0], np.cumsum(batch.link_count, dtype=np.int64)))
    return _count_waypoints(first, batch.robot, batch.edges, batch.target_known, link_first, batch.target_links)


@njit(cache=True, nogil=True)
def _count_waypoints(
    first: NDArray[np.int64],
    robot: NDArray[np.int32],
    edges: NDArray[np.uint32],
    target_known: NDArray[np.bool_],
    link_first: NDArray[np.int64],
    links: NDArray[np.uint16],
) -> NDArray[np.int32]:
    choices = np.zeros(len(robot), dtype=np.int32)
    for i in range(len(robot)):
        mask = edges[first[i] + robot[i]]
        while mask:
            mask &= mask - np.uint32(1)
            choices[i] += 1
        if target_known[i]:
            for j in range(link_first[i], link_first[i + 1]):
                if links[j] == robot[i]:
                    choices[i] += 1
                    break
    return choices
