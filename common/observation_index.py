"""Edges as row numbers: from lattice masks to neighbour rows, for validation and for attention over edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.jit import njit
from common.observation import NEIGHBOUR_COUNT, NEIGHBOUR_OFFSETS

# Bit of the edge to (dx, dy), at [dy + 2, dx + 2]; -1 for the corners and the middle, which are no neighbours.
NEIGHBOUR_BITS: NDArray[np.int8] = np.full((5, 5), -1, dtype=np.int8)
for _bit, (_dx, _dy) in enumerate(NEIGHBOUR_OFFSETS):
    NEIGHBOUR_BITS[_dy + 2, _dx + 2] = _bit

# Wider than any difference of two int16 offsets, so that dy * _ROW + dx orders points row-major without collisions.
_ROW = 1 << 20


def neighbour_table(
    count: NDArray[np.int32], offsets: NDArray[np.int16], edges: NDArray[np.uint32]
) -> NDArray[np.int32]:
    """Return the batch-global row of every neighbour of every viewpoint.

    The arrays are those of an `ObservationBatch`; the offsets of each observation must be row-major. An edge to a
    viewpoint that does not exist gives -1 too (messages with such edges are refused when they are decoded).

    Args:
        count: viewpoints per observation, shape (k,).
        offsets: shape (total, 2).
        edges: shape (total,).

    Returns:
        int32, shape (total, 20): the row of the viewpoint at the end of edge bit b in column b, or -1.
    """
    table = np.full((len(edges), NEIGHBOUR_COUNT), -1, dtype=np.int32)
    _fill_neighbours(count, offsets, edges, NEIGHBOUR_BITS, table)
    return table


@njit(cache=True, nogil=True)
def _fill_neighbours(count, offsets, edges, bits, table):  # type: ignore[no-untyped-def]
    """Sweep each observation once: five cursors, one per lattice row from dy = -2 to 2, only move forward."""
    keys = np.empty(len(edges), dtype=np.int64)
    for i in range(len(edges)):
        keys[i] = np.int64(offsets[i, 1]) * _ROW + offsets[i, 0]
    first = 0
    for n in count:
        last = first + n
        for dy in range(-2, 3):
            cursor = first
            for i in range(first, last):
                middle = keys[i] + dy * _ROW
                while cursor < last and keys[cursor] < middle - 2:
                    cursor += 1
                j = cursor
                while j < last and keys[j] <= middle + 2:
                    bit = bits[dy + 2, keys[j] - middle + 2]
                    if bit >= 0 and (edges[i] >> np.uint32(bit)) & np.uint32(1):
                        table[i, bit] = j
                    j += 1
        first = last
