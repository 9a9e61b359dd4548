"""How much of a map the stops of a tour see: counts over the sparse rows of `actors.expert.visibility`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from actors.expert.visibility import popcount
from common.jit import njit


@njit(cache=True, nogil=True)
def count_seen(
    pointer: NDArray[np.int64],
    tile: NDArray[np.int32],
    mask: NDArray[np.uint64],
    missing: NDArray[np.uint64],
    v: int,
) -> int:
    """Number of missing cells that viewpoint v sees."""
    total = 0
    for k in range(pointer[v], pointer[v + 1]):
        total += popcount(mask[k] & missing[tile[k]])
    return total


@njit(cache=True, nogil=True)
def seen_by_one(
    pointer: NDArray[np.int64],
    tile: NDArray[np.int32],
    mask: NDArray[np.uint64],
    missing: NDArray[np.uint64],
    once: NDArray[np.uint64],
    twice: NDArray[np.uint64],
    v: int,
    need: NDArray[np.uint64],
) -> int:
    """Write the missing cells that v alone of the tour sees into ``need`` (dense); return their number."""
    total = 0
    for k in range(pointer[v], pointer[v + 1]):
        t = tile[k]
        word = mask[k] & missing[t] & once[t] & ~twice[t]
        need[t] = word
        total += popcount(word)
    return total


@njit(cache=True, nogil=True)
def recount(
    pointer: NDArray[np.int64],
    tile: NDArray[np.int32],
    mask: NDArray[np.uint64],
    stops: NDArray[np.int64],
    size: int,
    once: NDArray[np.uint64],
    twice: NDArray[np.uint64],
) -> None:
    """Write which cells the stops see at least once, and at least twice."""
    once[:] = np.uint64(0)
    twice[:] = np.uint64(0)
    for s in range(size):
        for k in range(pointer[stops[s]], pointer[stops[s] + 1]):
            t = tile[k]
            twice[t] |= once[t] & mask[k]
            once[t] |= mask[k]


@njit(cache=True, nogil=True)
def recount_kept(
    pointer: NDArray[np.int64],
    tile: NDArray[np.int32],
    mask: NDArray[np.uint64],
    stops: NDArray[np.int64],
    dropped: NDArray[np.bool_],
    seen: NDArray[np.uint64],
    once: NDArray[np.uint64],
) -> None:
    """Write which cells the stops that were not dropped see, together with ``seen``."""
    once[:] = seen
    for s in range(len(stops)):
        if not dropped[s]:
            for k in range(pointer[stops[s]], pointer[stops[s] + 1]):
                once[tile[k]] |= mask[k]


@njit(cache=True, nogil=True)
def count_unseen(missing: NDArray[np.uint64], once: NDArray[np.uint64]) -> int:
    """Number of missing cells that no stop sees."""
    total = 0
    for t in range(len(missing)):
        if missing[t]:
            total += popcount(missing[t] & ~once[t])
    return total
