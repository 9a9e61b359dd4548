"""Who sees what, as sparse bit sets, and how much of what is missing the stops of a tour see.

What can be seen is parted into words of 64 cells that lie near to each other, called tiles. A viewpoint sees a disc
around it, so its set is stored sparsely: only the tiles of which it sees something. Counting what a viewpoint would
still find then takes about a hundred words, whatever the map's size.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from common.system.copies import copy_values
from common.system.jit import njit


@dataclass(frozen=True, slots=True, eq=False)
class Visibility:
    """The cells that each viewpoint sees, as sparse rows.

    Attributes:
        pointer: first entry of each viewpoint, int64, shape (n + 1,).
        tile: tile numbers, int32.
        mask: cells of the tile that are seen, uint64.
        tiles: number of tiles in all.
    """

    pointer: NDArray[np.int64]
    tile: NDArray[np.int32]
    mask: NDArray[np.uint64]
    tiles: int


def _popcount(typing_context: Any, word: Any) -> Any:
    del typing_context, word

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        del context, signature
        return builder.ctpop(arguments[0])

    return types.int64(types.uint64), generate


# Number of set bits of a 64-bit word, as int64: the processor's own instruction, for use in kernels.
popcount: Any = intrinsic(_popcount)


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
    copy_values(once, seen)
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


@njit(cache=True, nogil=True)
def count_bits(words: NDArray[np.uint64]) -> int:
    """Number of cells in a set."""
    total = 0
    for t in range(len(words)):
        total += popcount(words[t])
    return total


@njit(cache=True, nogil=True)
def add_seen(
    pointer: NDArray[np.int64],
    tile: NDArray[np.int32],
    mask: NDArray[np.uint64],
    viewpoints: NDArray[np.int64],
    words: NDArray[np.uint64],
) -> None:
    """Add to a set the cells that some viewpoints see."""
    for v in viewpoints:
        for k in range(pointer[v], pointer[v + 1]):
            words[tile[k]] |= mask[k]


@njit(cache=True, nogil=True)
def remove_seen(
    pointer: NDArray[np.int64],
    tile: NDArray[np.int32],
    mask: NDArray[np.uint64],
    viewpoints: NDArray[np.int64],
    words: NDArray[np.uint64],
) -> None:
    """Take away from a set the cells that some viewpoints see."""
    for v in viewpoints:
        for k in range(pointer[v], pointer[v + 1]):
            words[tile[k]] &= ~mask[k]


@njit(cache=True, nogil=True)
def _pack(
    pointer: NDArray[np.int64],
    items: NDArray[np.int32],
    rows: NDArray[np.int64],
    numbers: NDArray[np.int64],
    tiles: int,
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.uint64]]:
    words = np.zeros(tiles, dtype=np.uint64)
    begin = np.zeros(len(rows) + 1, dtype=np.int64)
    tile = np.empty(1024, dtype=np.int32)
    mask = np.empty(1024, dtype=np.uint64)
    size = 0
    for r in range(len(rows)):
        for k in range(pointer[rows[r]], pointer[rows[r] + 1]):
            number = numbers[items[k]]
            if number < 0:
                continue
            t = number >> 6
            if words[t] == 0:
                if size == len(tile):
                    tile = np.concatenate((tile, np.empty(size, dtype=np.int32)))
                    mask = np.concatenate((mask, np.empty(size, dtype=np.uint64)))
                tile[size] = t
                size += 1
            words[t] |= np.uint64(1) << np.uint64(number & 63)
        for k in range(begin[r], size):
            mask[k] = words[tile[k]]
            words[tile[k]] = np.uint64(0)
        begin[r + 1] = size
    return begin, tile[:size].copy(), mask[:size].copy()


def pack_rows(
    pointer: NDArray[np.int64], items: NDArray[np.int32], rows: NDArray[np.int64], numbers: NDArray[np.int64]
) -> Visibility:
    """Return some rows of a sparse list of what each viewpoint sees as bit sets.

    Args:
        pointer: first entry of each row, int64, shape (n + 1,).
        items: what the rows' viewpoints see, int32.
        rows: which rows, in this order, int64.
        numbers: bit of each item, int64; -1 leaves it out. Items near to each other should have numbers near to each
            other, or the rows get long.
    """
    tiles = int(numbers.max(initial=-1) + 64) >> 6
    begin, tile, mask = _pack(pointer, items, rows, numbers, tiles)
    return Visibility(begin, tile, mask, tiles)


def set_of(numbers: NDArray[np.int64], tiles: int) -> NDArray[np.uint64]:
    """Return the set with the given bits as words, uint64, shape (tiles,)."""
    bits = np.zeros(tiles * 64, dtype=np.uint8)
    bits[numbers] = 1
    return np.packbits(bits, bitorder="little").view("<u8").astype(np.uint64)
