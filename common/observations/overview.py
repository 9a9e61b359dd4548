"""How far robot, beacons and target are from one another: what the whole map looks like, at any size.

The robot, the beacons and the target are the *tokens* of an observation. Distances are those of shortest paths over its
graph, in ranges of the sensor, so that they mean the same at every resolution and spacing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.observations.index import NeighbourTable
from common.observations.observation import ObservationBatch
from common.observations.paths import TIE, shortest_paths
from common.system.jit import njit

CLOSENESS: Final = 5
"""Numbers that tell how close two tokens are: exp(-4 x), exp(-x), exp(-x / 4), log(1 + x) / 4 and whether a path leads
there, of the path's length x in ranges of the sensor."""
PAIR_FEATURES: Final = 5
"""Numbers that tell how a waypoint lies to a beacon: see `Overview.pairs`."""
_FARTHEST = 64.0
_LIMIT = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class Overview:
    """The tokens of k observations; rows are those of their `NeighbourTable`.

    Attributes:
        rows: row of each token, ascending, int64, shape (total tokens,).
        ptr: first token of each observation, then their number, int64, shape (k + 1,).
        distances: from each token to each node of its observation in lattice steps, inf where no path leads, float64,
            one behind the other.
        starts: where the distances of each token begin, int64, shape (total tokens,).
    """

    rows: NDArray[np.int64]
    ptr: NDArray[np.int64]
    distances: NDArray[np.float64]
    starts: NDArray[np.int64]

    @classmethod
    def of(cls, batch: ObservationBatch, table: NeighbourTable, tokens: NDArray[np.bool_]) -> Overview:
        """Measure the paths from all tokens.

        Args:
            batch: k observations.
            table: their neighbours.
            tokens: which rows are tokens, shape (nodes,).
        """
        rows = np.flatnonzero(tokens)
        ptr = np.searchsorted(rows, table.node_ptr)
        sizes = np.repeat(np.diff(table.node_ptr), np.diff(ptr))
        ends = np.cumsum(sizes)
        starts = ends - sizes
        distances = np.full(int(sizes.sum()), np.inf)
        _measure(
            table.rows, table.lengths, table.extremes, table.node_ptr, batch.has_target, rows, ptr, starts, distances
        )
        return cls(rows, ptr, distances, starts)

    def closeness(self, node_ptr: NDArray[np.int64], reach: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return how close the tokens of each observation are to one another.

        Args:
            node_ptr: first row of each observation, then the number of rows, shape (k + 1,).
            reach: range of the sensor in lattice steps, shape (k,).

        Returns:
            Of t tokens t * t times `CLOSENESS` numbers, those of the first token first, the observations one behind the
            other, float32, shape (total, `CLOSENESS`).
        """
        counts = np.diff(self.ptr)
        out = np.zeros((int((counts**2).sum()), CLOSENESS), dtype=np.float32)
        _fill_closeness(self.rows, self.ptr, self.distances, self.starts, node_ptr, reach, out)
        return out

    def pairs(
        self,
        node_ptr: NDArray[np.int64],
        robot_rows: NDArray[np.int64],
        reach: NDArray[np.float32],
        pairs: NDArray[np.int64],
    ) -> NDArray[np.float32]:
        """Return how each waypoint lies to each beacon.

        1. The detour of the way from the robot to the beacon through the waypoint, in ranges of the sensor, up to 4.
        2. The same as log(1 + lattice steps), up to 4.
        3. Whether there is none: the waypoint is on a shortest path to the beacon.
        4. The path from the robot to the beacon, in ranges of the sensor, up to 4.
        5. The path from the robot to the waypoint, likewise.

        Where no path leads to the beacon, a detour is the largest one.

        Args:
            node_ptr: first row of each observation, then the number of rows, shape (k + 1,).
            robot_rows: row of each observation's robot, shape (k,).
            reach: range of the sensor in lattice steps, shape (k,).
            pairs: observation, row of the beacon (a token) and row of the waypoint, shape (total pairs, 3).

        Returns:
            float32, shape (total pairs, `PAIR_FEATURES`).
        """
        out = np.zeros((len(pairs), PAIR_FEATURES), dtype=np.float32)
        of_beacon = self.starts[np.searchsorted(self.rows, pairs[:, 1])]
        of_robot = self.starts[np.searchsorted(self.rows, robot_rows)]
        _fill_pairs(pairs, of_beacon, of_robot, self.distances, node_ptr, robot_rows, reach, out)
        return out


@njit(cache=True, nogil=True)
def _measure(
    neighbours: NDArray[np.int32],
    lengths: NDArray[np.float64],
    extremes: NDArray[np.float64],
    node_ptr: NDArray[np.int64],
    has_target: NDArray[np.bool_],
    rows: NDArray[np.int64],
    ptr: NDArray[np.int64],
    starts: NDArray[np.int64],
    distances: NDArray[np.float64],
) -> None:
    for g in range(len(has_target)):
        first, last = node_ptr[g], node_ptr[g + 1]
        target = last - first - 1 if has_target[g] else np.int64(-1)
        order = np.empty(last - first, dtype=np.int64)
        for token in range(ptr[g], ptr[g + 1]):
            here = rows[token] - first
            distance = distances[starts[token] : starts[token] + last - first]
            if here == target:
                # No path leads through a target, so those from it begin at its links.
                for slot in range(neighbours.shape[1]):
                    link = neighbours[first + target, slot] - first
                    if link >= 0 and link != target:
                        distance[link] = lengths[first + target, slot]
            else:
                distance[here] = 0.0
            shortest_paths(neighbours[first:last], lengths[first:last], extremes[g], first, target, distance, order)
            distance[here] = 0.0


@njit(cache=True, nogil=True)
def _fill_closeness(
    rows: NDArray[np.int64],
    ptr: NDArray[np.int64],
    distances: NDArray[np.float64],
    starts: NDArray[np.int64],
    node_ptr: NDArray[np.int64],
    reach: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    at = 0
    for g in range(len(reach)):
        for one in range(ptr[g], ptr[g + 1]):
            for other in range(ptr[g], ptr[g + 1]):
                length = distances[starts[one] + rows[other] - node_ptr[g]]
                x = min(length / reach[g], _FARTHEST)
                out[at, 0] = math.exp(-4.0 * x)
                out[at, 1] = math.exp(-x)
                out[at, 2] = math.exp(-x / 4.0)
                out[at, 3] = math.log1p(x) / 4.0
                out[at, 4] = length < np.inf
                at += 1


@njit(cache=True, nogil=True)
def _fill_pairs(
    pairs: NDArray[np.int64],
    of_beacon: NDArray[np.int64],
    of_robot: NDArray[np.int64],
    distances: NDArray[np.float64],
    node_ptr: NDArray[np.int64],
    robot_rows: NDArray[np.int64],
    reach: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    for p in range(len(pairs)):
        g, waypoint = pairs[p, 0], pairs[p, 2]
        there = distances[of_beacon[p] + robot_rows[g] - node_ptr[g]]
        step = distances[of_robot[g] + waypoint - node_ptr[g]]
        detour = np.inf
        if there < np.inf:
            detour = max(step + distances[of_beacon[p] + waypoint - node_ptr[g]] - there, 0.0)
        out[p, 0] = min(detour / reach[g], _LIMIT)
        out[p, 1] = min(math.log1p(detour), _LIMIT)
        out[p, 2] = detour < TIE
        out[p, 3] = min(there / reach[g], _LIMIT)
        out[p, 4] = min(step / reach[g], _LIMIT)
