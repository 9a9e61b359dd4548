"""Which frontier cells each viewpoint sees, as sparse rows: `Mapper.sightings` and what is asked of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.system.jit import njit

SightRows = tuple[NDArray[np.int64], NDArray[np.int32]]
"""Frontier cells by viewpoint: where each one's begin, and the cells; see `Mapper.sightings`."""


@njit(cache=True, nogil=True)
def rows_within(
    pointer: NDArray[np.int64],
    seen: NDArray[np.int32],
    positions: NDArray[np.float64],
    frontiers: NDArray[np.float64],
    reach: float,
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Return the rows of `Mapper.sightings` without the cells that are farther than `reach`, metres."""
    begin = np.zeros(len(pointer), dtype=np.int64)
    kept = np.empty(len(seen), dtype=np.int32)
    size = 0
    for node in range(len(positions)):
        for k in range(pointer[node], pointer[node + 1]):
            x = frontiers[seen[k], 0] - positions[node, 0]
            y = frontiers[seen[k], 1] - positions[node, 1]
            if x * x + y * y <= reach * reach:
                kept[size] = seen[k]
                size += 1
        begin[node + 1] = size
    return begin, kept[:size]


@njit(cache=True, nogil=True)
def row_digests(
    pointer: NDArray[np.int64], seen: NDArray[np.int32], nodes: NDArray[np.int64], cells: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return a number that tells apart which cells each of some nodes sees; never negative."""
    digests = np.zeros(len(nodes), dtype=np.int64)
    for n in range(len(nodes)):
        digest = np.uint64(0)
        for k in range(pointer[nodes[n]], pointer[nodes[n] + 1]):
            # Multiplications by odd constants (SplitMix64) spread the bits; the sum does not depend on the order.
            word = np.uint64(cells[seen[k]]) * np.uint64(0x9E3779B97F4A7C15)
            word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            digest += word ^ (word >> np.uint64(27))
        digests[n] = np.int64(digest >> np.uint64(1))
    return digests


def see_any(rows: SightRows, wanted: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which nodes see any of the wanted cells, bool, shape (nodes,)."""
    seeing: NDArray[np.bool_] = _any_of(*rows, wanted)
    return seeing


@njit(cache=True, nogil=True)
def _any_of(pointer: NDArray[np.int64], seen: NDArray[np.int32], wanted: NDArray[np.bool_]) -> NDArray[np.bool_]:
    seeing = np.zeros(len(pointer) - 1, dtype=np.bool_)
    for node in range(len(seeing)):
        for k in range(pointer[node], pointer[node + 1]):
            if wanted[seen[k]]:
                seeing[node] = True
                break
    return seeing
