"""Graph reduction: the network reads only the nodes that matter to a decision (docs/design.md, "The network").

Kept are the robot's surroundings, all useful viewpoints, all beacons, a target with its links, and every shortest path
from the robot to a beacon. Where these are many, *tokens* may stand for them: useful viewpoints only within the range
of the robot's sensor, and shortest paths only where they begin. Beacons and the reference route stand for what is far
away, so that the number of nodes grows little with the size of the world. Node features are computed before, on the
whole graph: distances and degrees stay exact.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.observations.feature_sets import DISTANCE_SCALE, FEATURE_NAMES, REACH_SCALE
from common.system.jit import njit

SURROUNDINGS = 4.0
"""Nodes within this graph distance of the robot are kept, lattice steps."""
MOST_NODES = 128
"""Nodes of an observation of which no more than the tokens stay when there are more."""
TOKEN_SURROUNDINGS = 2.3
"""Likewise of the tokens: as far as an edge goes."""
TOKEN_PATHS = 6.0
"""Shortest paths to beacons are tokens up to this graph distance of the robot, lattice steps."""

_NAMES = FEATURE_NAMES["extended"]
_UTILITY, _BEACON, _TARGET = (_NAMES.index(name) for name in ("utility", "beacon", "target"))
_DISTANCE, _ON_PATH = _NAMES.index("robot_graph_distance"), _NAMES.index("on_beacon_path")
_ON_ROUTE = FEATURE_NAMES["guided"].index("on_route")
_REACH = FEATURE_NAMES["guided"].index("reach")


def kept_rows(
    features: NDArray[np.float32],
    neighbours: NDArray[np.int32],
    robot_rows: NDArray[np.int64],
    node_ptr: NDArray[np.int64],
    *,
    tokens: bool = False,
) -> NDArray[np.bool_]:
    """Choose the rows that stay.

    Args:
        features: of the set ``extended`` or ``guided``, shape (nodes, F); the latter tells of routes, whose viewpoints
            stay.
        neighbours: shape (nodes, slots), -1 where absent.
        robot_rows: row of each observation's robot, shape (k,).
        node_ptr: first row of each observation, then the number of rows, shape (k + 1,).
        tokens: where more than `MOST_NODES` of an observation would stay, only its tokens do; needs the set ``guided``.

    Returns:
        bool, shape (nodes,); robot, its neighbours, beacons and targets are always among them.
    """
    distance = features[:, _DISTANCE] * DISTANCE_SCALE
    useful, on_path = features[:, _UTILITY] > 0.0, features[:, _ON_PATH] > 0.0
    always = (features[:, _BEACON] > 0.0) | (features[:, _TARGET] > 0.0)
    if features.shape[1] > _ON_ROUTE:
        always |= features[:, _ON_ROUTE] > 0.0
    for rows in (robot_rows, np.flatnonzero(features[:, _TARGET])):
        around = neighbours[rows]
        always[around[around >= 0]] = True
        always[rows] = True
    kept: NDArray[np.bool_] = always | useful | on_path | (distance <= SURROUNDINGS)
    if not tokens:
        return kept
    counts = np.add.reduceat(kept, node_ptr[:-1], dtype=np.int64)
    large = np.repeat(counts > MOST_NODES, np.diff(node_ptr))
    near = distance <= TOKEN_SURROUNDINGS
    near |= useful & (distance <= features[:, _REACH] * REACH_SCALE)
    near |= on_path & (distance <= TOKEN_PATHS)
    return np.where(large, always | near, kept)


@njit(cache=True, nogil=True)
def renumbered(neighbours: NDArray[np.int32], kept: NDArray[np.bool_], place: NDArray[np.int64]) -> NDArray[np.int32]:
    """Return the neighbour table of the kept rows in their new numbers, -1 for a neighbour that is gone.

    Args:
        neighbours: shape (nodes, slots).
        kept: rows that stay, shape (nodes,).
        place: new number of each row, -1 where it is gone, shape (nodes,).
    """
    out = np.full((kept.sum(), neighbours.shape[1]), -1, dtype=np.int32)
    for row in range(len(kept)):
        if kept[row]:
            for slot in range(neighbours.shape[1]):
                other = neighbours[row, slot]
                if other >= 0:
                    out[place[row], slot] = place[other]
    return out
