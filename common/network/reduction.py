"""Graph reduction: the network reads only the nodes that a decision turns on (RECIPES, "Speed reached").

Kept are the robot's surroundings, all useful viewpoints, all beacons, a target with its links, and every shortest path
from the robot to a beacon. Of the *tokens*, useful viewpoints are kept only within the sensor's range of the robot, and
shortest paths only where they begin: beacons and the reference route stand for what is far away, so that the number of
nodes grows little with the size of the world. Node features are computed before, on the whole graph: distances and
degrees stay exact.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.features import FEATURE_NAMES
from common.jit import njit

SURROUNDINGS = 4.0
"""Nodes within this graph distance of the robot are kept, lattice steps."""
TOKEN_SURROUNDINGS = 2.3
"""Likewise of the tokens: as far as an edge goes."""
TOKEN_PATHS = 6.0
"""Shortest paths to beacons are tokens up to this graph distance of the robot, lattice steps."""

_NAMES = FEATURE_NAMES["extended"]
_UTILITY, _BEACON, _ROBOT, _TARGET = (_NAMES.index(name) for name in ("utility", "beacon", "robot", "target"))
_DISTANCE, _ON_PATH = _NAMES.index("robot_graph_distance"), _NAMES.index("on_beacon_path")
_ON_ROUTE = FEATURE_NAMES["guided"].index("on_route")
_REACH = FEATURE_NAMES["guided"].index("reach")
_SCALE = 20.0
_REACH_SCALE = 10.0


def kept_rows(
    features: NDArray[np.float32], neighbours: NDArray[np.int32], robot_rows: NDArray[np.int64], *, tokens: bool = False
) -> NDArray[np.bool_]:
    """Choose the rows that stay.

    Args:
        features: of the set ``extended`` or ``guided``, shape (nodes, F); the latter tells of routes, whose viewpoints
            stay.
        neighbours: shape (nodes, slots), -1 where absent.
        robot_rows: row of each observation's robot, shape (k,).
        tokens: keep the tokens alone; needs the set ``guided``.

    Returns:
        bool, shape (nodes,); robot, its neighbours, beacons and targets are always among them.
    """
    distance = features[:, _DISTANCE] * _SCALE
    useful, on_path = features[:, _UTILITY] > 0.0, features[:, _ON_PATH] > 0.0
    if tokens:
        useful &= distance <= features[:, _REACH] * _REACH_SCALE
        on_path &= distance <= TOKEN_PATHS
    near = distance <= (TOKEN_SURROUNDINGS if tokens else SURROUNDINGS)
    kept = near | useful | on_path | (features[:, _BEACON] > 0.0) | (features[:, _TARGET] > 0.0)
    if features.shape[1] > _ON_ROUTE:
        kept |= features[:, _ON_ROUTE] > 0.0
    for rows in (robot_rows, np.flatnonzero(features[:, _TARGET])):
        around = neighbours[rows]
        kept[around[around >= 0]] = True
        kept[rows] = True
    return kept


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
