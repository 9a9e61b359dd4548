"""Options of the network: each begins silent beside trained weights, and the networks without torch agree with it."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from common.config import NetworkConfig
from common.errors import WeightsError
from common.network.factory import make_policy_network
from common.network.graph_arrays import GraphArrays
from common.network.graph_batch import GraphBatch
from common.network.inference import make_inference
from common.network.parameters import initial_parameters, parameter_shapes, with_options
from common.network.state import load_arrays, to_arrays
from common.observations.index import neighbour_table
from common.policies.policy_file import read_weights
from common.policies.shipped import shipped_policy
from learner.algorithm.augment import SYMMETRIES, transform_observations
from tests.effort import examples
from tests.observations import random_batch
from tests.paths import all_path_lengths

OPTIONS: dict[str, dict[str, object]] = {
    "belief_map": {"belief_map": True},
    "beacon_attention": {"beacon_attention": 2},
    "detours": {"detours": True},
}
OPTIONS["all"] = {name: value for option in OPTIONS.values() for name, value in option.items()}
each_option = pytest.mark.parametrize("option", OPTIONS.values(), ids=OPTIONS.keys())


def small(**changes: object) -> NetworkConfig:
    return NetworkConfig(**{"width": 16, "heads": 2, "layers": 1, "feedforward": 2, **changes})


def network_of(config: NetworkConfig, weights: dict[str, np.ndarray]) -> torch.nn.Module:
    network = make_policy_network(config)
    load_arrays(network, weights)
    return network


@each_option
def test_an_option_changes_nothing_at_first_and_can_learn(option: dict[str, object]) -> None:
    weights, card = read_weights(shipped_policy("exploration"))
    config = card.network.model_copy(update=option)
    batch = random_batch(np.random.default_rng(0), 6, image=True)
    before = network_of(card.network, weights)(GraphBatch.from_observations(batch, card.network))
    network = network_of(config, with_options(weights, card.network, config))
    after = network(GraphBatch.from_observations(batch, config))
    assert torch.equal(after.log_beacon, before.log_beacon)
    assert torch.equal(after.log_waypoint, before.log_waypoint)
    fresh = torch.optim.SGD(network.parameters(), lr=1.0)
    for _ in range(2):
        fresh.zero_grad()
        output = network(GraphBatch.from_observations(batch, config))
        (output.log_waypoint.exp().square().sum() + output.log_beacon.exp().square().sum()).backward()
        fresh.step()
    new = {name: value for name, value in network.named_parameters() if name not in weights}
    assert new
    assert all(value.grad is not None and value.grad.abs().sum() > 0.0 for value in new.values()), "all of it learns"


@each_option
@settings(max_examples=examples(15))
@given(seed=st.integers(0, 2**32 - 1), graph=st.sampled_from(["full", "reduced"]))
def test_without_torch_it_decides_alike(option: dict[str, object], seed: int, graph: str) -> None:
    config = small(**option, graph=graph)
    weights = initial_parameters(config, 1)
    rng = np.random.default_rng(seed)
    weights = {name: value + rng.normal(0.0, 0.2, value.shape).astype(np.float32) for name, value in weights.items()}
    network = network_of(config, weights)
    assert {name: value.shape for name, value in to_arrays(network).items()} == parameter_shapes(config)
    batch = random_batch(rng, 3, image=True)
    together = network(GraphBatch.from_observations(batch, config))
    decide = make_inference(config, weights)
    said = [decide(GraphArrays.from_observations(batch.select(np.arange(3) == k), config)) for k in range(len(batch))]
    beacons = np.concatenate([log_beacon for log_beacon, _ in said])
    waypoints = np.concatenate([log_waypoint.ravel() for _, log_waypoint in said])
    np.testing.assert_allclose(together.log_beacon.detach().numpy(), beacons, atol=1e-4)
    np.testing.assert_allclose(together.log_waypoint.detach().numpy(), waypoints, atol=1e-4)


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), graph=st.sampled_from(["full", "reduced"]))
def test_paths_between_beacons_are_measured_on_the_whole_graph(seed: int, graph: str) -> None:
    batch = random_batch(np.random.default_rng(seed), 2, (2, 20), image=True)
    arrays = GraphArrays.from_observations(batch, small(**OPTIONS["all"], graph=graph))
    closeness = iter(arrays.closeness)
    pairs = iter(arrays.pair_features)
    for k, between in enumerate(all_path_lengths(batch, neighbour_table(batch))):
        rows = arrays.token_rows[arrays.token_ptr[k] : arrays.token_ptr[k + 1]]
        tokens, robot, reach = arrays.nodes[rows], int(batch.robot[k]), float(batch.reach[k])
        assert robot in tokens
        for one in tokens:
            for other in tokens:
                lengths = between[one, other] / reach
                found = next(closeness)
                assert found[4] == np.isfinite(lengths)
                np.testing.assert_allclose(found[1], np.exp(-lengths), atol=1e-6)
        for b in arrays.nodes[arrays.beacon_rows[arrays.beacon_ptr[k] : arrays.beacon_ptr[k + 1]]]:
            for w in arrays.nodes[arrays.waypoint_rows[arrays.waypoint_ptr[k] : arrays.waypoint_ptr[k + 1]]]:
                found = next(pairs)
                straight = between[robot, b]
                # Only a waypoint that is the target, through which no path leads, can be on a shorter way.
                detour = max(between[robot, w] + between[w, b] - straight, 0.0) if np.isfinite(straight) else np.inf
                np.testing.assert_allclose(found[0], min(detour / reach, 4.0), atol=1e-5)
                assert found[2] == (detour < 1e-6)
                np.testing.assert_allclose(found[3], min(straight / reach, 4.0), atol=1e-5)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_turning_the_world_leaves_paths_alone(seed: int) -> None:
    rng = np.random.default_rng(seed)
    batch, config = random_batch(rng, 3, (2, 25), image=True), small(**OPTIONS["all"])
    before = GraphArrays.from_observations(batch, config)
    after = GraphArrays.from_observations(transform_observations(batch, rng.integers(SYMMETRIES, size=3)), config)
    np.testing.assert_array_equal(after.token_rows, before.token_rows)
    np.testing.assert_array_equal(after.closeness, before.closeness)
    np.testing.assert_array_equal(after.pair_features, before.pair_features)


def test_what_cannot_work_is_refused() -> None:
    with pytest.raises(ValidationError, match="beacon_attention is about beacons, and variant 'vanilla' chooses none"):
        small(variant="vanilla", beacon_attention=2)
    with pytest.raises(ValidationError, match="detours is about beacons"):
        small(variant="cnn", features="paper", detours=True)
    one, two = small(beacon_attention=1), small(beacon_attention=2)
    with pytest.raises(WeightsError, match=r"set network\.beacon_attention=1"):
        with_options(initial_parameters(one, 0), one, two)


def test_weights_of_another_number_of_heads_are_refused() -> None:
    two, four = small(heads=2), small(heads=4)
    assert parameter_shapes(two) == parameter_shapes(four)
    with pytest.raises(WeightsError, match=r"network\.heads=2"):
        with_options(initial_parameters(two, 0), two, four)
