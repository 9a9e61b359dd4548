"""An indexed binary heap in three arrays: a priority queue of vertices in which each can be found and moved.

The arrays are handed over one by one: kernels take longer when they come in a tuple. They are ``keys`` of the entries,
compared part by part, int64, shape (n, 2); ``nodes``, the vertices of the entries, int32, shape (n,); and ``where``,
the place of each vertex among the entries, -1 for none, int32, shape (n,). The caller knows how many entries there are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.system.jit import njit


@njit(cache=True, nogil=True)
def less(a: NDArray[np.int64], b: NDArray[np.int64]) -> bool:
    """Whether a key comes before another."""
    return a[0] < b[0] or (a[0] == b[0] and a[1] < b[1])


@njit(cache=True, nogil=True)
def settle(
    keys: NDArray[np.int64],
    nodes: NDArray[np.int32],
    where: NDArray[np.int32],
    size: int,
    place: int,
    key: NDArray[np.int64],
    node: int,
) -> None:
    """Put an entry into the heap of `size` entries whose place `place` is void."""
    while place and less(key, keys[(place - 1) >> 1]):
        _move(keys, nodes, where, place, (place - 1) >> 1)
        place = (place - 1) >> 1
    while True:
        child = 2 * place + 1
        if child >= size:
            break
        if child + 1 < size and less(keys[child + 1], keys[child]):
            child += 1
        if not less(keys[child], key):
            break
        _move(keys, nodes, where, place, child)
        place = child
    keys[place, 0], keys[place, 1] = key[0], key[1]
    nodes[place] = node
    where[node] = place


@njit(cache=True, nogil=True)
def remove(keys: NDArray[np.int64], nodes: NDArray[np.int32], where: NDArray[np.int32], size: int, node: int) -> int:
    """Take the entry of a vertex out of the heap of `size` entries; return how many are left."""
    place = where[node]
    where[node] = -1
    last = size - 1
    if place != last:
        key = np.array([keys[last, 0], keys[last, 1]])
        settle(keys, nodes, where, last, np.int64(place), key, nodes[last])
    return last


@njit(cache=True, nogil=True)
def _move(keys: NDArray[np.int64], nodes: NDArray[np.int32], where: NDArray[np.int32], place: int, from_: int) -> None:
    keys[place, 0], keys[place, 1] = keys[from_, 0], keys[from_, 1]
    nodes[place] = nodes[from_]
    where[nodes[place]] = place
