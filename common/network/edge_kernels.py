"""Attention along the edges of ragged graphs: compiled kernels, forward and backward, without padding."""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from common.network.parallel import Kernel
from common.network.vector_ops import add_scaled, dot, exp_negative
from common.system.jit import njit


@functools.cache
def edge_kernels(head: int) -> tuple[Kernel, Kernel]:
    """Return (forward, backward) for heads of size ``head``.

    ``forward(qkv, neighbours, out, weights, first, last)`` reads queries, keys and values side by side, float32
    (nodes, 3 d), and writes the attended values (nodes, d) and the attention weights (nodes, slots, heads) of nodes
    ``first`` to ``last``; weights of absent neighbours stay as they were.
    ``backward(grad, qkv, neighbours, weights, grad_qkv, first, last)`` adds to ``grad_qkv``. No edge leaves its
    observation, so ranges of whole observations may run side by side.
    """
    scale = np.float32(1.0 / math.sqrt(head))

    @njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
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
        flat, mixed = qkv.reshape(-1), out.reshape(-1)
        scores = np.empty(slots * heads, dtype=np.float32)
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
            for h in range(heads):
                top[h] = np.float32(-3e38)
                total[h] = 0.0
            query = 3 * width * i
            for m in range(found):
                key = 3 * width * rows[m] + width
                for h in range(heads):
                    score = dot(flat, query + h * head, flat, key + h * head, head) * scale
                    scores[m * heads + h] = score
                    top[h] = max(top[h], score)
            for m in range(found):
                for h in range(heads):
                    scores[m * heads + h] -= top[h]
            for at in range(found * heads):
                scores[at] = exp_negative(scores[at])
            for m in range(found):
                for h in range(heads):
                    total[h] += scores[m * heads + h]
            for h in range(heads):
                total[h] = np.float32(1.0) / total[h]
            for c in range(width):
                mixed[width * i + c] = 0.0
            for m in range(found):
                value = 3 * width * rows[m] + 2 * width
                for h in range(heads):
                    share = scores[m * heads + h] * total[h]
                    weights[i, places[m], h] = share
                    add_scaled(mixed, width * i + h * head, share, flat, value + h * head, head)

    @njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
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
        flat, above, below = qkv.reshape(-1), grad.reshape(-1), grad_qkv.reshape(-1)
        slope = np.empty((slots, heads), dtype=np.float32)
        mean = np.empty(heads, dtype=np.float32)
        for i in range(first, last):
            for h in range(heads):
                mean[h] = 0.0
            for slot in range(slots):
                j = neighbours[i, slot]
                if j < 0:
                    continue
                value = 3 * width * j + 2 * width
                for h in range(heads):
                    share = weights[i, slot, h]
                    rise = dot(above, width * i + h * head, flat, value + h * head, head)
                    slope[slot, h] = rise
                    mean[h] += share * rise
                    add_scaled(below, value + h * head, share, above, width * i + h * head, head)
            query = 3 * width * i
            for slot in range(slots):
                j = neighbours[i, slot]
                if j < 0:
                    continue
                key = 3 * width * j + width
                for h in range(heads):
                    factor = weights[i, slot, h] * (slope[slot, h] - mean[h]) * scale
                    add_scaled(below, query + h * head, factor, flat, key + h * head, head)
                    add_scaled(below, key + h * head, factor, flat, query + h * head, head)

    return forward, backward
