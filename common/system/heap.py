"""A binary heap in two arrays, for Dijkstra's algorithm in compiled kernels."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from common.system.jit import njit


@njit(cache=True, nogil=True)
def push(keys: NDArray[Any], items: NDArray[Any], size: int, key: Any, item: int) -> int:
    """Add an item to the heap in the first ``size`` places of both arrays; return the new size."""
    place = size
    while place > 0:
        parent = (place - 1) >> 1
        if keys[parent] <= key:
            break
        keys[place], items[place] = keys[parent], items[parent]
        place = parent
    keys[place], items[place] = key, item
    return size + 1


@njit(cache=True, nogil=True)
def pop(keys: NDArray[Any], items: NDArray[Any], size: int) -> int:
    """Drop the item of the smallest key, which is ``items[0]``; return the new size."""
    size -= 1
    key, item = keys[size], items[size]
    place = 0
    while True:
        child = 2 * place + 1
        if child >= size:
            break
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[place], items[place] = keys[child], items[child]
        place = child
    keys[place], items[place] = key, item
    return size
