"""The critics equal the dense implementation, values and gradients."""

from __future__ import annotations

import numpy as np
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from common.config import NetworkConfig
from common.network.graph_batch import GraphBatch
from learner.algorithm.critic import HierarchicalCritic
from tests.common.network.dense import KINK, dense_batch, dense_critic, watch_kinks
from tests.observations import random_batch


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 4), variant=st.sampled_from(["vanilla", "hdplanner"]))
def test_equals_dense_implementation(seed: int, count: int, variant: str) -> None:
    torch.manual_seed(seed)
    config = NetworkConfig(variant=variant, width=16, heads=2, layers=2, feedforward=2)
    critic = HierarchicalCritic(config)
    observations = random_batch(np.random.default_rng(seed), count, (2, 25))
    batch = GraphBatch.from_observations(observations, config)
    dense = dense_batch(observations, batch.features, variant == "vanilla")
    before_relu = watch_kinks(critic)
    ours = critic(batch)
    assume(min(before_relu) > KINK)
    theirs = tuple(dense_critic(critic.encoder, head, dense) for head in (critic.first, critic.second))
    weights = torch.rand_like(ours[0])
    found = torch.autograd.grad(((ours[0] + 2 * ours[1]) * weights).sum(), list(critic.parameters()))
    expected = torch.autograd.grad(((theirs[0] + 2 * theirs[1]) * weights).sum(), list(critic.parameters()))
    for mine, other in zip((*ours, *found), (*theirs, *expected), strict=True):
        torch.testing.assert_close(mine, other, atol=5e-4, rtol=1e-3)
    assert len(ours[0]) == len(batch.arrays.pairs)
    assert not torch.equal(*ours)
