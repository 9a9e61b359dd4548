"""Attention over ragged graphs on the CPU: compiled kernels, forward and backward, without padding.

A kernel is made for each head size, so that the compiler unrolls the loops over a head. All take a range of nodes or
of observations and release the GIL: `run_parallel` spreads whole observations over threads, and since no edge leaves
its observation, no two threads write to one row.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Kernel = Callable[..., None]


@functools.cache
def edge_kernels(head: int) -> tuple[Kernel, Kernel]:
    """Return (forward, backward) of attention along edges for heads of size ``head``.

    ``forward(qkv, neighbours, out, weights, first, last)`` reads queries, keys and values side by side, float32
    (nodes, 3 d), and writes the attended values (nodes, d) and the attention weights (nodes, 22, heads).
    ``backward(grad, qkv, neighbours, weights, grad_qkv, first, last)`` adds to ``grad_qkv``.
    """
    scale = np.float32(1.0 / math.sqrt(head))

    @njit(cache=True, nogil=True, fastmath=True)
    def forward(
        qkv: NDArray[np.float32],
        neighbours: NDArray[np.int32],
        out: NDArray[np.float32],
        weights: NDArray[np.float32],
        first: int,
        last: int,
    ) -> None:
        width = out.shape[1]
        heads = width // head
        slots = neighbours.shape[1]
        rows = np.empty(slots, dtype=np.int64)
        places = np.empty(slots, dtype=np.int64)
        top = np.empty(heads, dtype=np.float32)
        total = np.empty(heads, dtype=np.float32)
        for i in range(first, last):
            found = 0
            for slot in range(slots):
                if neighbours[i, slot] >= 0:
                    rows[found] = neighbours[i, slot]
                    places[found] = slot
                    found += 1
            query = qkv[i]
            mixed = out[i]
            for h in range(heads):
                top[h] = -np.inf
                total[h] = 0.0
            for m in range(found):
                key = qkv[rows[m], width : 2 * width]
                weight = weights[i, places[m]]
                for h in range(heads):
                    score = np.float32(0.0)
                    for c in range(head):
                        score += query[h * head + c] * key[h * head + c]
                    score *= scale
                    weight[h] = score
                    top[h] = max(top[h], score)
            for m in range(found):
                weight = weights[i, places[m]]
                for h in range(heads):
                    weight[h] = math.exp(weight[h] - top[h])
                    total[h] += weight[h]
            for h in range(heads):
                total[h] = np.float32(1.0) / total[h]
            for c in range(width):
                mixed[c] = 0.0
            for m in range(found):
                value = qkv[rows[m], 2 * width :]
                weight = weights[i, places[m]]
                for h in range(heads):
                    share = weight[h] * total[h]
                    weight[h] = share
                    for c in range(head):
                        mixed[h * head + c] += share * value[h * head + c]

    @njit(cache=True, nogil=True, fastmath=True)
    def backward(
        grad: NDArray[np.float32],
        qkv: NDArray[np.float32],
        neighbours: NDArray[np.int32],
        weights: NDArray[np.float32],
        grad_qkv: NDArray[np.float32],
        first: int,
        last: int,
    ) -> None:
        width = grad.shape[1]
        heads = width // head
        slots = neighbours.shape[1]
        rows = np.empty(slots, dtype=np.int64)
        places = np.empty(slots, dtype=np.int64)
        slope = np.empty((slots, heads), dtype=np.float32)
        mean = np.empty(heads, dtype=np.float32)
        for i in range(first, last):
            found = 0
            for slot in range(slots):
                if neighbours[i, slot] >= 0:
                    rows[found] = neighbours[i, slot]
                    places[found] = slot
                    found += 1
            query = qkv[i]
            above = grad[i]
            grad_query = grad_qkv[i]
            for h in range(heads):
                mean[h] = 0.0
            for m in range(found):
                value = qkv[rows[m], 2 * width :]
                grad_value = grad_qkv[rows[m], 2 * width :]
                weight = weights[i, places[m]]
                for h in range(heads):
                    share = weight[h]
                    rise = np.float32(0.0)
                    for c in range(head):
                        rise += above[h * head + c] * value[h * head + c]
                        grad_value[h * head + c] += share * above[h * head + c]
                    slope[m, h] = rise
                    mean[h] += share * rise
            for m in range(found):
                key = qkv[rows[m], width : 2 * width]
                grad_key = grad_qkv[rows[m], width : 2 * width]
                weight = weights[i, places[m]]
                for h in range(heads):
                    factor = weight[h] * (slope[m, h] - mean[h]) * scale
                    for c in range(head):
                        grad_query[h * head + c] += factor * key[h * head + c]
                        grad_key[h * head + c] += factor * query[h * head + c]

    return forward, backward


@functools.cache
def cross_kernels(head: int) -> tuple[Kernel, Kernel]:
    """Return (forward, backward) of the attention of a few queries over all nodes of their observation.

    ``forward(queries, query_ptr, kv, node_ptr, weight_ptr, out, weights, first, last)`` reads queries (queries, d),
    keys and values side by side (nodes, 2 d), and writes (queries, d) and the attention weights: flat, one block
    (nodes of the observation, heads) per query, which starts at its ``weight_ptr``.
    ``backward(grad, queries, query_ptr, kv, node_ptr, weight_ptr, weights, grad_queries, grad_kv, first, last)``
    adds to the gradients.
    """
    scale = np.float32(1.0 / math.sqrt(head))

    @njit(cache=True, nogil=True, fastmath=True)
    def forward(
        queries: NDArray[np.float32],
        query_ptr: NDArray[np.int64],
        kv: NDArray[np.float32],
        node_ptr: NDArray[np.int64],
        weight_ptr: NDArray[np.int64],
        out: NDArray[np.float32],
        weights: NDArray[np.float32],
        first: int,
        last: int,
    ) -> None:
        width = queries.shape[1]
        heads = width // head
        top = np.empty(heads, dtype=np.float32)
        total = np.empty(heads, dtype=np.float32)
        for g in range(first, last):
            for i in range(query_ptr[g], query_ptr[g + 1]):
                query = queries[i]
                mixed = out[i]
                for h in range(heads):
                    top[h] = -np.inf
                    total[h] = 0.0
                at = weight_ptr[i]
                for j in range(node_ptr[g], node_ptr[g + 1]):
                    key = kv[j]
                    weight = weights[at : at + heads]
                    for h in range(heads):
                        score = np.float32(0.0)
                        for c in range(head):
                            score += query[h * head + c] * key[h * head + c]
                        score *= scale
                        weight[h] = score
                        top[h] = max(top[h], score)
                    at += heads
                at = weight_ptr[i]
                for _ in range(node_ptr[g], node_ptr[g + 1]):
                    weight = weights[at : at + heads]
                    for h in range(heads):
                        weight[h] = math.exp(weight[h] - top[h])
                        total[h] += weight[h]
                    at += heads
                for h in range(heads):
                    total[h] = np.float32(1.0) / total[h]
                for c in range(width):
                    mixed[c] = 0.0
                at = weight_ptr[i]
                for j in range(node_ptr[g], node_ptr[g + 1]):
                    value = kv[j, width:]
                    weight = weights[at : at + heads]
                    for h in range(heads):
                        share = weight[h] * total[h]
                        weight[h] = share
                        for c in range(head):
                            mixed[h * head + c] += share * value[h * head + c]
                    at += heads

    @njit(cache=True, nogil=True, fastmath=True)
    def backward(
        grad: NDArray[np.float32],
        queries: NDArray[np.float32],
        query_ptr: NDArray[np.int64],
        kv: NDArray[np.float32],
        node_ptr: NDArray[np.int64],
        weight_ptr: NDArray[np.int64],
        weights: NDArray[np.float32],
        grad_queries: NDArray[np.float32],
        grad_kv: NDArray[np.float32],
        first: int,
        last: int,
    ) -> None:
        width = queries.shape[1]
        heads = width // head
        mean = np.empty(heads, dtype=np.float32)
        for g in range(first, last):
            nodes = node_ptr[g + 1] - node_ptr[g]
            slope = np.empty((nodes, heads), dtype=np.float32)
            for i in range(query_ptr[g], query_ptr[g + 1]):
                query = queries[i]
                above = grad[i]
                grad_query = grad_queries[i]
                for h in range(heads):
                    mean[h] = 0.0
                at = weight_ptr[i]
                for n in range(nodes):
                    value = kv[node_ptr[g] + n, width:]
                    grad_value = grad_kv[node_ptr[g] + n, width:]
                    weight = weights[at : at + heads]
                    for h in range(heads):
                        share = weight[h]
                        rise = np.float32(0.0)
                        for c in range(head):
                            rise += above[h * head + c] * value[h * head + c]
                            grad_value[h * head + c] += share * above[h * head + c]
                        slope[n, h] = rise
                        mean[h] += share * rise
                    at += heads
                at = weight_ptr[i]
                for n in range(nodes):
                    key = kv[node_ptr[g] + n]
                    grad_key = grad_kv[node_ptr[g] + n]
                    weight = weights[at : at + heads]
                    for h in range(heads):
                        factor = weight[h] * (slope[n, h] - mean[h]) * scale
                        for c in range(head):
                            grad_query[h * head + c] += factor * key[h * head + c]
                            grad_key[h * head + c] += factor * query[h * head + c]
                    at += heads

    return forward, backward


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
