"""The ragged policy network equals the dense one, values and gradients."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from common.config import NetworkConfig
from common.network.attention import (
    CrossAttention,
    EdgeAttention,
    cross_attention,
    edge_attention,
    gathered_attention,
)
from common.network.factory import make_policy_network
from common.network.graph_batch import GraphBatch
from common.network.parameters import parameter_shapes
from common.network.segment import segment_sum
from common.network.state import to_arrays
from tests.common.network.dense import KINK, dense_batch, dense_policy, watch_kinks
from tests.effort import examples
from tests.observations import random_batch

VARIANTS = ("vanilla", "hierarchical", "hdplanner")
# From one head of all 16 numbers to 16 heads of one; each number of heads has kernels of its own to be compiled.
HEADS = (1, 4, 16)


def small(variant: str = "hdplanner", **changes: object) -> NetworkConfig:
    return NetworkConfig(**{"variant": variant, "width": 16, "heads": 2, "layers": 2, "feedforward": 2, **changes})


def gradients(module: torch.nn.Module) -> dict[str, torch.Tensor]:
    found = {name: p.grad.clone() for name, p in module.named_parameters() if p.grad is not None}
    module.zero_grad()
    return found


@settings(max_examples=examples(8), deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 5),
    variant=st.sampled_from(VARIANTS),
    features=st.sampled_from(["paper", "extended", "guided"]),
    heads=st.sampled_from(HEADS),
)
def test_equals_dense_implementation(seed: int, count: int, variant: str, features: str, heads: int) -> None:
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    config = small(variant, features=features, heads=heads)
    network = make_policy_network(config)
    observations = random_batch(rng, count, (2, 30))
    batch = GraphBatch.from_observations(observations, config)
    before_relu = watch_kinks(network)
    output = network(batch)
    assume(min(before_relu) > KINK)
    dense = dense_batch(observations, batch.features, variant == "vanilla")
    log_beacon, log_waypoint = dense_policy(network, dense)
    torch.testing.assert_close(output.log_beacon, log_beacon, atol=2e-5, rtol=1e-5)
    torch.testing.assert_close(output.log_waypoint, log_waypoint, atol=2e-5, rtol=1e-5)

    weights = torch.rand_like(log_waypoint), torch.rand_like(log_beacon)
    ((output.log_waypoint * weights[0]).sum() + (output.log_beacon * weights[1]).sum()).backward()
    found = gradients(network)
    ((log_waypoint * weights[0]).sum() + (log_beacon * weights[1]).sum()).backward()
    for name, expected in gradients(network).items():
        torch.testing.assert_close(found[name], expected, atol=5e-4, rtol=1e-3, msg=lambda m, n=name: f"{n}: {m}")


@pytest.mark.parametrize("variant", VARIANTS)
def test_smallest_graph_has_certain_choices(variant: str) -> None:
    config = small(variant)
    observations = random_batch(np.random.default_rng(3), 1, (2, 2), ("none",))
    observations.beacon[:] = [True, False]
    output = make_policy_network(config)(GraphBatch.from_observations(observations, config))
    assert output.log_beacon.tolist() == [0.0]
    assert output.log_waypoint.tolist() == [0.0]


@pytest.mark.parametrize("threads", [1, 2])
def test_probabilities_sum_to_one_for_any_number_of_threads(threads: int) -> None:
    config = small()
    batch = GraphBatch.from_observations(random_batch(np.random.default_rng(0), 9), config)
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        output = make_policy_network(config)(batch)
        output.log_waypoint.sum().backward()
    finally:
        torch.set_num_threads(before)
    of_beacons = segment_sum(output.log_beacon.exp(), batch.beacon_graph, len(batch))
    of_waypoints = segment_sum(output.log_waypoint.exp(), batch.pair_beacon, len(batch.beacon_rows))
    torch.testing.assert_close(of_beacons, torch.ones(len(batch)))
    torch.testing.assert_close(of_waypoints, torch.ones(len(batch.beacon_rows)))


def test_an_observation_is_independent_of_its_companions() -> None:
    config = small()
    network = make_policy_network(config)
    observations = random_batch(np.random.default_rng(1), 4)
    together = network(GraphBatch.from_observations(observations, config))
    alone = observations.select(np.array([False, False, True, False]))
    batch = GraphBatch.from_observations(observations, config)
    mine = batch.pair_graph == 2
    torch.testing.assert_close(
        together.log_waypoint[mine], network(GraphBatch.from_observations(alone, config)).log_waypoint
    )


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), heads=st.sampled_from(HEADS))
def test_attention_of_other_devices_equals_the_kernels(seed: int, heads: int) -> None:
    torch.manual_seed(seed)
    batch = GraphBatch.from_observations(random_batch(np.random.default_rng(seed), 3), small())
    nodes = torch.randn(len(batch.features), 16, requires_grad=True)
    edge, cross = EdgeAttention(16, heads), CrossAttention(16, heads)
    queries = torch.randn(len(batch.beacon_rows), 16, requires_grad=True)
    ptr = batch.arrays.beacon_ptr
    along_edges = edge(nodes, batch)
    kernels = along_edges, along_edges, cross(queries, ptr, cross.kv(nodes), batch)
    others = (
        edge.out(edge_attention(edge.qkv(nodes), batch, heads)),
        edge.out(gathered_attention(edge.qkv(nodes), batch.neighbours, heads)),
        cross.out(cross_attention(cross.query(queries), ptr, cross.kv(nodes), batch, heads)),
    )
    for ours, theirs in zip(kernels, others, strict=True):
        torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=1e-5)
        weights = torch.rand_like(ours)
        for inputs in (nodes, queries):
            expected = torch.autograd.grad((theirs * weights).sum(), inputs, retain_graph=True, allow_unused=True)[0]
            found = torch.autograd.grad((ours * weights).sum(), inputs, retain_graph=True, allow_unused=True)[0]
            if expected is not None:
                torch.testing.assert_close(found, expected, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("variant", VARIANTS)
def test_parameter_shapes_describe_the_network(variant: str) -> None:
    config = small(variant, layers=3)
    arrays = to_arrays(make_policy_network(config))
    assert {name: array.shape for name, array in arrays.items()} == parameter_shapes(config)


def test_bf16_autocast_stays_close() -> None:
    config = small()
    network = make_policy_network(config)
    batch = GraphBatch.from_observations(random_batch(np.random.default_rng(5), 4), config)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        rough = network(batch)
    assert rough.log_waypoint.dtype == torch.float32
    rough.log_waypoint.exp().square().sum().backward()
    assert all(torch.isfinite(p.grad).all() for p in network.parameters() if p.grad is not None)
    torch.testing.assert_close(rough.log_waypoint, network(batch).log_waypoint, atol=0.2, rtol=0.1)
