"""Copy pieces of a ring's column behind one another, in machine code and without the GIL."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from common.system.jit import njit

T = TypeVar("T", bound=np.generic)


def gather(column: NDArray[T], first: NDArray[np.int64], length: NDArray[np.int32]) -> NDArray[T]:
    """Return rows ``first[i] .. first[i] + length[i]`` of a contiguous column for all i, one piece behind the other."""
    out = np.empty((int(length.sum()), *column.shape[1:]), dtype=column.dtype)
    # As bytes, so that one kernel serves every column.
    row_bytes = column.strides[0]
    source, target = column.reshape(-1).view(np.uint8), out.reshape(-1).view(np.uint8)
    _copy(source, first * row_bytes, length * np.int64(row_bytes), target)
    return out


@njit(cache=True, nogil=True)
def _copy(
    source: NDArray[np.uint8], first: NDArray[np.int64], length: NDArray[np.int64], out: NDArray[np.uint8]
) -> None:
    at = 0
    for i in range(len(first)):
        size = length[i]
        piece = source[first[i] : first[i] + size]
        target = out[at : at + size]
        for k in range(size):
            target[k] = piece[k]
        at += size
