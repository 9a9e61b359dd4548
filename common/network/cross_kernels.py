"""Attention of a few queries over all nodes of their observation: compiled kernels, forward and backward."""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from common.network.parallel import Kernel
from common.network.vector_ops import add_scaled, dot, exp_negative
from common.system.jit import njit


@functools.cache
def cross_kernels(head: int) -> tuple[Kernel, Kernel]:
    """Return (forward, backward) for heads of size ``head``.

    ``forward(queries, query_ptr, kv, node_ptr, weight_ptr, out, weights, first, last)`` reads queries (queries, d),
    keys and values side by side (nodes, 2 d), and writes (queries, d) and the attention weights of observations
    ``first`` to ``last``: flat, one block (nodes of the observation, heads) per query, from its ``weight_ptr``.
    ``backward(grad, queries, query_ptr, kv, node_ptr, weight_ptr, weights, grad_queries, grad_kv, first, last)``
    adds to the gradients.
    """
    scale = np.float32(1.0 / math.sqrt(head))

    @njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
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
        asking, flat, mixed = queries.reshape(-1), kv.reshape(-1), out.reshape(-1)
        top = np.empty(heads, dtype=np.float32)
        total = np.empty(heads, dtype=np.float32)
        for g in range(first, last):
            begin, nodes = node_ptr[g], node_ptr[g + 1] - node_ptr[g]
            for i in range(query_ptr[g], query_ptr[g + 1]):
                scores = weights[weight_ptr[i] : weight_ptr[i] + nodes * heads]
                for h in range(heads):
                    top[h] = np.float32(-3e38)
                    total[h] = 0.0
                for n in range(nodes):
                    key = 2 * width * (begin + n)
                    for h in range(heads):
                        score = dot(asking, width * i + h * head, flat, key + h * head, head) * scale
                        scores[n * heads + h] = score
                        top[h] = max(top[h], score)
                for n in range(nodes):
                    for h in range(heads):
                        scores[n * heads + h] -= top[h]
                for at in range(nodes * heads):
                    scores[at] = exp_negative(scores[at])
                for n in range(nodes):
                    for h in range(heads):
                        total[h] += scores[n * heads + h]
                for h in range(heads):
                    total[h] = np.float32(1.0) / total[h]
                for c in range(width):
                    mixed[width * i + c] = 0.0
                for n in range(nodes):
                    value = 2 * width * (begin + n) + width
                    for h in range(heads):
                        share = scores[n * heads + h] * total[h]
                        scores[n * heads + h] = share
                        add_scaled(mixed, width * i + h * head, share, flat, value + h * head, head)

    @njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
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
        asking, flat, above = queries.reshape(-1), kv.reshape(-1), grad.reshape(-1)
        below_query, below = grad_queries.reshape(-1), grad_kv.reshape(-1)
        mean = np.empty(heads, dtype=np.float32)
        for g in range(first, last):
            begin, nodes = node_ptr[g], node_ptr[g + 1] - node_ptr[g]
            slope = np.empty((nodes, heads), dtype=np.float32)
            for i in range(query_ptr[g], query_ptr[g + 1]):
                shares = weights[weight_ptr[i] : weight_ptr[i] + nodes * heads]
                for h in range(heads):
                    mean[h] = 0.0
                for n in range(nodes):
                    value = 2 * width * (begin + n) + width
                    for h in range(heads):
                        share = shares[n * heads + h]
                        rise = dot(above, width * i + h * head, flat, value + h * head, head)
                        slope[n, h] = rise
                        mean[h] += share * rise
                        add_scaled(below, value + h * head, share, above, width * i + h * head, head)
                for n in range(nodes):
                    key = 2 * width * (begin + n)
                    for h in range(heads):
                        factor = shares[n * heads + h] * (slope[n, h] - mean[h]) * scale
                        add_scaled(below_query, width * i + h * head, factor, flat, key + h * head, head)
                        add_scaled(below, key + h * head, factor, asking, width * i + h * head, head)

    return forward, backward
