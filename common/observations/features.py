"""Node features: what the network sees of each viewpoint, computed from the observation alone."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from common.observations.feature_sets import DISTANCE_SCALE, REACH_SCALE, FeatureSet, feature_count
from common.observations.index import EXTRA_SLOTS, NeighbourTable
from common.observations.observation import NEIGHBOUR_COUNT, STEP_UNITS, ObservationBatch
from common.observations.paths import TIE, RobotPaths, shortest_paths
from common.system.jit import njit

# The largest value of a position or distance.
_LIMIT = 8.0
# Cells to a lattice step where a frontier cell of the set `guided` counts once: 4 m of 0.25 m, the public benchmark's.
_CELLS = 16.0
# On a lattice the degree is 1 at most; where small rooms crowd it may be more.
_DEGREE_LIMIT = 2.0


def node_features(
    batch: ObservationBatch, table: NeighbourTable, features: FeatureSet, paths: RobotPaths | None
) -> NDArray[np.float32]:
    """Compute the features of all nodes, the targets included.

    Every value is bounded. Distances are in lattice steps; *graph* distances run along edges and never lead through
    the target. Of a target that is not known yet, its links are the beacons: its graph distance is then the
    optimistic estimate over them.

    ====  ======================  ==================================================================  ==========
    col.  name                    meaning                                                             range
    ====  ======================  ==================================================================  ==========
    0, 1  x, y                    position relative to the robot / 20                                 -8 .. 8
    2     utility                 log(1 + observable frontiers) / 4                                   0 .. 2.78
    3     visited                 the robot has been here                                             0, 1
    4     beacon                  stands for a group of useful viewpoints; a known target             0, 1
    5     robot                   the robot's node                                                    0, 1
    6     target                  the target's node                                                   0, 1
    7, 8  target_direction        unit vector from this node to the target, zeros without one         -1 .. 1
    9     target_distance         straight distance to the target / 20, 0 without one                 0 .. 8
    10    robot_graph_distance    graph distance from the robot / 20                                  0 .. 8
    11    degree                  number of neighbours / 20                                           0 .. 2
    12    useful_graph_distance   graph distance to the nearest viewpoint with utility / 20           0 .. 8
    13    on_beacon_path          lies on a shortest path (any, if several) from robot to a beacon    0, 1
    14    target_graph_distance   graph distance to the target / 20, 0 without one                    0 .. 8
    15    on_route                lies on the reference route                                         0, 1
    16    route_distance          length of that route from the robot to here / 20, 0 beside it       0 .. 8
    17    route_next              the first viewpoint of that route                                   0, 1
    18    reach                   range of the sensor / 10                                            0 .. 8
    ====  ======================  ==================================================================  ==========

    Columns 0 to 9 are the set ``paper``, 0 to 14 the set ``extended``, all 19 the set ``guided``; ``ariadne`` (columns
    0 to 3) and ``ca`` (those, and 7 to 9) are picked out of ``paper`` with `feature_columns`. In ``guided``
    frontiers are counted by their length, in sixteenths of a lattice step, so that neither the size of the cells nor
    that of the lattice changes what a utility means. The length of a route is that of the straight lines between its
    viewpoints.

    Args:
        batch: k observations.
        table: their neighbours.
        features: which set; one of its own (see `common.observations.feature_sets.computed_set`).
        paths: from the robots; the set ``paper`` needs none.

    Returns:
        float32, shape (nodes, F).

    Raises:
        ValueError: the set needs paths, and there are none.
    """
    out = np.zeros((len(table.rows), feature_count(features)), dtype=np.float32)
    _fill_plain(
        batch.count,
        batch.offsets,
        batch.utility,
        batch.visited,
        batch.beacon,
        batch.robot,
        batch.has_target,
        batch.target_known,
        batch.target_offset,
        table.node_ptr,
        out,
    )
    if features == "paper":
        return out
    if paths is None:
        raise ValueError(f"the features {features!r} need the paths from the robots: pass those of `robot_paths`")
    _fill_extended(
        batch.count,
        batch.utility,
        batch.has_target,
        table.rows,
        table.lengths,
        table.extremes,
        table.node_ptr,
        paths.distance,
        paths.order,
        paths.reached,
        out,
    )
    if features == "guided":
        _fill_guided(
            batch.count,
            batch.offsets,
            batch.utility,
            batch.robot,
            batch.cell,
            batch.reach,
            batch.route_count,
            batch.route,
            table.node_ptr,
            out,
        )
    return out


@njit(cache=True, nogil=True)
def _fill_plain(
    count: NDArray[np.int32],
    offsets: NDArray[np.int16],
    utility: NDArray[np.uint16],
    visited: NDArray[np.bool_],
    beacon: NDArray[np.bool_],
    robot: NDArray[np.int32],
    has_target: NDArray[np.bool_],
    target_known: NDArray[np.bool_],
    target_offset: NDArray[np.float32],
    node_ptr: NDArray[np.int64],
    out: NDArray[np.float32],
) -> None:
    """Fill columns 0 to 9."""
    view = 0
    for g in range(len(count)):
        first, last = node_ptr[g], node_ptr[g + 1]
        n = count[g]
        x = np.zeros(last - first)
        y = np.zeros(last - first)
        for i in range(n):
            x[i] = offsets[view + i, 0] / STEP_UNITS
            y[i] = offsets[view + i, 1] / STEP_UNITS
            row = out[first + i]
            if utility[view + i] > 0:
                row[2] = math.log1p(utility[view + i]) / 4.0
            row[3] = visited[view + i]
            row[4] = beacon[view + i]
        out[first + robot[g], 5] = 1.0
        if has_target[g]:
            x[n] = target_offset[g, 0]
            y[n] = target_offset[g, 1]
            out[first + n, 4] = target_known[g]
            out[first + n, 6] = 1.0
        for i in range(last - first):
            row = out[first + i]
            row[0] = min(max(x[i] / DISTANCE_SCALE, -_LIMIT), _LIMIT)
            row[1] = min(max(y[i] / DISTANCE_SCALE, -_LIMIT), _LIMIT)
            if has_target[g]:
                dx, dy = x[n] - x[i], y[n] - y[i]
                distance = math.hypot(dx, dy)
                if distance > 0.0:
                    row[7] = dx / distance
                    row[8] = dy / distance
                row[9] = min(distance / DISTANCE_SCALE, _LIMIT)
        view += n


@njit(cache=True, nogil=True)
def _fill_extended(
    count: NDArray[np.int32],
    utility: NDArray[np.uint16],
    has_target: NDArray[np.bool_],
    neighbours: NDArray[np.int32],
    lengths: NDArray[np.float64],
    extremes: NDArray[np.float64],
    node_ptr: NDArray[np.int64],
    from_robot: NDArray[np.float64],
    orders: NDArray[np.int64],
    reached: NDArray[np.int64],
    out: NDArray[np.float32],
) -> None:
    """Fill columns 10 to 14."""
    view = 0
    for g in range(len(count)):
        n, first, last = count[g], node_ptr[g], node_ptr[g + 1]
        _fill_distances(
            utility[view : view + n],
            n if has_target[g] else -1,
            first,
            neighbours[first:last],
            lengths[first:last],
            extremes[g],
            from_robot[first:last],
            orders[first : first + reached[g]],
            out[first:last],
        )
        view += n


@njit(cache=True, nogil=True)
def _fill_distances(
    utility: NDArray[np.uint16],
    target: int,
    first: int,
    neighbours: NDArray[np.int32],
    lengths: NDArray[np.float64],
    extremes: NDArray[np.float64],
    from_robot: NDArray[np.float64],
    order: NDArray[np.int64],
    out: NDArray[np.float32],
) -> None:
    """Fill columns 10 to 14 of one observation, whose nodes start at row ``first`` of the table; target -1 is none."""
    nodes, slots = neighbours.shape
    found = np.empty(nodes, dtype=np.int64)
    distance = np.full(nodes, np.inf)
    for i in range(len(utility)):
        if utility[i] > 0:
            distance[i] = 0.0
    shortest_paths(neighbours, lengths, extremes, first, target, distance, found)
    for i in range(nodes):
        row = out[i]
        degree = 0
        for slot in range(slots - EXTRA_SLOTS):
            degree += neighbours[i, slot] >= 0
        row[10] = min(from_robot[i] / DISTANCE_SCALE, _LIMIT)
        row[11] = min(degree / NEIGHBOUR_COUNT, _DEGREE_LIMIT)
        row[12] = min(distance[i] / DISTANCE_SCALE, _LIMIT)
        row[13] = row[4] > 0.0 and from_robot[i] < np.inf
    # From the farthest node inwards, each marked node marks all its predecessors on shortest paths.
    for j in order[::-1]:
        if out[j, 13] > 0.0:
            for slot in range(slots):
                i = neighbours[j, slot] - first
                if i < 0 or i in (j, target):
                    continue
                if abs(from_robot[i] + lengths[j, slot] - from_robot[j]) < TIE:
                    out[i, 13] = 1.0
    if target >= 0:
        distance[:] = np.inf
        for slot in range(slots - EXTRA_SLOTS):
            i = neighbours[target, slot] - first
            if i >= 0:
                distance[i] = lengths[target, slot]
        shortest_paths(neighbours, lengths, extremes, first, target, distance, found)
        distance[target] = 0.0
        for i in range(nodes):
            out[i, 14] = min(distance[i] / DISTANCE_SCALE, _LIMIT)


@njit(cache=True, nogil=True)
def _fill_guided(
    count: NDArray[np.int32],
    offsets: NDArray[np.int16],
    utility: NDArray[np.uint16],
    robot: NDArray[np.int32],
    cell: NDArray[np.float32],
    reach: NDArray[np.float32],
    route_count: NDArray[np.int32],
    route: NDArray[np.uint16],
    node_ptr: NDArray[np.int64],
    out: NDArray[np.float32],
) -> None:
    """Fill columns 15 to 18, and column 2 anew."""
    view = 0
    at = 0
    for g in range(len(count)):
        first, last = node_ptr[g], node_ptr[g + 1]
        for i in range(count[g]):
            out[first + i, 2] = math.log1p(utility[view + i] * cell[g] * _CELLS) / 4.0
        for row in range(first, last):
            out[row, 18] = min(reach[g] / REACH_SCALE, _LIMIT)
        here = np.int64(robot[g])
        length = 0.0
        for k in range(at, at + route_count[g]):
            there = np.int64(route[k])
            x = np.float64(offsets[view + there, 0]) - offsets[view + here, 0]
            y = np.float64(offsets[view + there, 1]) - offsets[view + here, 1]
            length += math.hypot(x, y) / STEP_UNITS
            row = out[first + there]
            if row[15] == 0.0:
                row[15] = 1.0
                row[16] = min(length / DISTANCE_SCALE, _LIMIT)
            if k == at:
                row[17] = 1.0
            here = there
        at += route_count[g]
        view += count[g]
