"""Ragged reductions against numpy, empty segments included."""

from __future__ import annotations

import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from common.network.segment import segment_argmax, segment_log_softmax, segment_logsumexp, segment_sum


@given(sizes=st.lists(st.integers(0, 5), min_size=1, max_size=6), seed=st.integers(0, 1000))
def test_reductions(sizes: list[int], seed: int) -> None:
    values = np.random.default_rng(seed).normal(size=sum(sizes)).astype(np.float32) * 30
    owner = torch.repeat_interleave(torch.tensor(sizes))
    tensor, k = torch.from_numpy(values), len(sizes)
    parts = np.split(values, np.cumsum(sizes)[:-1])
    first = np.cumsum(sizes) - sizes
    np.testing.assert_allclose(segment_sum(tensor, owner, k), [p.sum() for p in parts], rtol=1e-4, atol=1e-3)
    best = segment_argmax(tensor, owner, k)
    logs = segment_log_softmax(tensor, owner, k).numpy()
    sums = segment_logsumexp(tensor, owner, k).numpy()
    for g, part in enumerate(parts):
        if len(part) == 0:
            assert best[g] == len(values)
            assert sums[g] == -np.inf
            continue
        assert best[g] == first[g] + part.argmax()
        total = np.logaddexp.reduce(part)
        np.testing.assert_allclose(sums[g], total, rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(logs[first[g] : first[g] + len(part)], part - total, rtol=1e-4, atol=1e-4)
