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
def edge_kernels(head: int, heads: int) -> tuple[Kernel, Kernel]:
    """Return (forward, backward) for ``heads`` heads of size ``head``: constants, so that loops over them unroll.

    ``forward(qkv, neighbours, out, weights, first, last)`` reads queries, keys and values side by side, float32
    (nodes, 3 d), and writes the attended values (nodes, d) and the attention weights (nodes, slots, heads) of nodes
    ``first`` to ``last``; weights of absent neighbours stay as they were, and none are written to an empty array.
    ``backward(grad, qkv, neighbours, weights, grad_qkv, first, last)`` adds to ``grad_qkv``. No edge leaves its
    observation, so ranges of whole observations may run side by side.
    """
    scale = np.float32(1.0 / math.sqrt(head))
    width = heads * head

    @njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
    def forward(
        qkv: NDArray[np.float32],
        neighbours: NDArray[np.int32],
        out: NDArray[np.float32],
        weights: NDArray[np.float32],
        first: int,
        last: int,
    ) -> None:
        slots = neighbours.shape[1]
        flat, mixed = qkv.reshape(-1), out.reshape(-1)
        scores = np.empty(slots * heads, dtype=np.float32)
        keep = len(weights) > 0
        keys = np.empty(slots, dtype=np.int64)
        places = np.empty(slots, dtype=np.int64)
        # Places are unsigned where numba would ask of each whether it counts from the end.
        for i in range(first, last):
            found = 0
            for slot in range(slots):
                row = neighbours[i, np.uint64(slot)]
                if row >= 0:
                    keys[np.uint64(found)] = 3 * width * np.int64(row) + width
                    places[np.uint64(found)] = slot
                    found += 1
            query = 3 * width * i
            for m in range(found):
                key = keys[np.uint64(m)]
                for h in range(heads):
                    score = dot(flat, query + h * head, flat, key + h * head, head)
                    scores[np.uint64(m * heads + h)] = score * scale
            for h in range(heads):
                top = np.float32(-3e38)
                for m in range(found):
                    score = scores[np.uint64(m * heads + h)]
                    top = score if score > top else top
                for m in range(found):
                    scores[np.uint64(m * heads + h)] -= top
            for at in range(found * heads):
                scores[np.uint64(at)] = exp_negative(scores[np.uint64(at)])
            for c in range(width):
                mixed[np.uint64(width * i + c)] = 0.0
            for m in range(found):
                value = keys[np.uint64(m)] + width
                for h in range(heads):
                    share = scores[np.uint64(m * heads + h)]
                    add_scaled(mixed, width * i + h * head, share, flat, value + h * head, head)
            for h in range(heads):
                total = np.float32(0.0)
                for m in range(found):
                    total += scores[np.uint64(m * heads + h)]
                total = np.float32(1.0) / total
                for c in range(head):
                    mixed[np.uint64(width * i + h * head + c)] *= total
                if keep:
                    for m in range(found):
                        weights[i, places[m], h] = scores[m * heads + h] * total

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
