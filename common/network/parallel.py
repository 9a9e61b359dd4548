"""Compiled kernels on several threads: whole observations are spread over them."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

Kernel = Callable[..., None]


@functools.cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="attention")


def run_parallel(kernel: Kernel, arguments: tuple[Any, ...], bounds: NDArray[np.int64]) -> None:
    """Call ``kernel(*arguments, first, last)`` for each range between two ``bounds``, one range per thread.

    numba's own parallel loops are left aside: their default threading layer must not be entered from two Python
    threads at once, and a learner ingests while it trains.
    """
    if len(bounds) == 2:
        kernel(*arguments, bounds[0], bounds[1])
        return
    pool = _pool(len(bounds) - 1)
    futures = [pool.submit(kernel, *arguments, first, last) for first, last in itertools.pairwise(bounds)]
    for future in futures:
        future.result()


def balanced_bounds(ptr: NDArray[np.int64], threads: int) -> NDArray[np.int64]:
    """Cut observations into at most ``threads`` runs of about equal numbers of nodes; return their first indices.

    Args:
        ptr: first node of each observation, then the number of nodes, shape (k + 1,).
        threads: runs at most.
    """
    shares = np.linspace(0, ptr[-1], threads + 1)[1:-1]
    return np.unique(np.concatenate([[0], np.searchsorted(ptr, shares), [len(ptr) - 1]]))
