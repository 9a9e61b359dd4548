"""Copies of arrays in compiled kernels.

Where a kernel assigns an array to a slice, numba compiles a message about shapes that do not fit, which takes a process
five seconds the first time. Here shapes are the caller's business.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from common.system.jit import njit


@njit(cache=True, nogil=True)
def copy_values(target: NDArray[Any], source: NDArray[Any]) -> None:
    """Copy an array to the beginning of another one, both of shape (n,); as for a slice, but for overlaps."""
    for k in range(len(source)):
        target[k] = source[k]


@njit(cache=True, nogil=True)
def copy_rows(target: NDArray[Any], source: NDArray[Any]) -> None:
    """Copy rows to the beginning of an array of as many columns, both of shape (n, m)."""
    for k in range(len(source)):
        for c in range(source.shape[1]):
            target[k, c] = source[k, c]
