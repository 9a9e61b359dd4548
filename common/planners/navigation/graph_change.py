"""From one graph of places to the next: which vertices stand for the same place, and which have other edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.system.jit import njit


@njit(cache=True, nogil=True)
def match_places(
    old_x: NDArray[np.int64], old_y: NDArray[np.int64], x: NDArray[np.int64], y: NDArray[np.int64]
) -> NDArray[np.int32]:
    """Return the new number of each old place, -1 for those that are no more."""
    new_of = np.full(len(old_x), -1, dtype=np.int32)
    new = 0
    for old in range(len(old_x)):
        while new < len(x) and (y[new] < old_y[old] or (y[new] == old_y[old] and x[new] < old_x[old])):
            new += 1
        if new < len(x) and x[new] == old_x[old] and y[new] == old_y[old]:
            new_of[old] = new
    return new_of


@njit(cache=True, nogil=True)
def changed_vertices(
    new_of: NDArray[np.int32],
    old_pointer: NDArray[np.int64],
    old_neighbours: NDArray[np.int32],
    old_costs: NDArray[np.int64],
    old_goal_costs: NDArray[np.int64],
    pointer: NDArray[np.int64],
    neighbours: NDArray[np.int32],
    costs: NDArray[np.int64],
    goal_costs: NDArray[np.int64],
) -> NDArray[np.bool_]:
    """Return which vertices are new, or have other edges or another last leg than before."""
    changed = np.ones(len(pointer) - 1, dtype=np.bool_)
    for old in range(len(new_of)):
        node = new_of[old]
        if node < 0:
            continue
        begin, old_begin = pointer[node], old_pointer[old]
        count = pointer[node + 1] - begin
        same = count == old_pointer[old + 1] - old_begin and goal_costs[node] == old_goal_costs[old]
        k = 0
        while same and k < count:
            same = (
                new_of[old_neighbours[old_begin + k]] == neighbours[begin + k]
                and old_costs[old_begin + k] == costs[begin + k]
            )
            k += 1
        changed[node] = not same
    return changed
