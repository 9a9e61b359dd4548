"""Reductions over ragged sets: item i belongs to segment ``owner[i]``; no segment is padded.

A segment without items has sum 0 and no maximum; nothing here fails on one.
"""

from __future__ import annotations

import torch
from torch import Tensor


def segment_sum(values: Tensor, owner: Tensor, segments: int) -> Tensor:
    """Sum values, shape (items, ...), per segment: shape (segments, ...)."""
    return values.new_zeros((segments, *values.shape[1:])).index_add(0, owner, values)


def segment_max(values: Tensor, owner: Tensor, segments: int) -> Tensor:
    """Return the largest value per segment, shape (segments,); -inf where a segment is empty. No gradient."""
    top = values.new_full((segments,), -torch.inf)
    return top.scatter_reduce(0, owner, values.detach(), "amax")


def segment_log_softmax(logits: Tensor, owner: Tensor, segments: int) -> Tensor:
    """Normalise logits, shape (items,), to log-probabilities within each segment."""
    if logits.numel() == 0:
        return logits
    shifted = logits - segment_max(logits, owner, segments).index_select(0, owner)
    total = segment_sum(shifted.exp(), owner, segments)
    return shifted - total.log().index_select(0, owner)


def segment_logsumexp(logits: Tensor, owner: Tensor, segments: int) -> Tensor:
    """Return log Σ exp per segment, shape (segments,); -inf where a segment is empty."""
    top = segment_max(logits, owner, segments)
    shifted = logits - top.index_select(0, owner)
    return segment_sum(shifted.exp(), owner, segments).log() + top


def segment_argmax(values: Tensor, owner: Tensor, segments: int) -> Tensor:
    """Return the first item with the largest value per segment, int64, shape (segments,).

    An empty segment gets the number of items, which is no valid index.
    """
    items = len(values)
    top = segment_max(values, owner, segments).index_select(0, owner)
    index = torch.arange(items, device=values.device)
    candidate = torch.where(values.detach() == top, index, items)
    first = torch.full((segments,), items, dtype=torch.int64, device=values.device)
    return first.scatter_reduce(0, owner, candidate, "amin")
