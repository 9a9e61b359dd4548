"""A policy decides like its torch network, refuses wrong weights and draws from what it says."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config import NetworkConfig
from common.errors import WeightsError
from common.network.factory import make_policy_network
from common.network.graph_batch import GraphBatch
from common.network.parameters import initial_parameters
from common.network.state import load_arrays, to_arrays
from common.observations.observation import Observation, ObservationBatch
from common.policies.policy import Policy
from tests.observations import observations, random_observation

CONFIG = NetworkConfig(width=16, heads=2, layers=2)


@settings(max_examples=30, deadline=None)
@given(observation=observations(30), seed=st.integers(0, 1000), variant=st.sampled_from(["vanilla", "hdplanner"]))
def test_equals_the_torch_network(observation: Observation, seed: int, variant: str) -> None:
    config = NetworkConfig(width=16, heads=2, layers=2, variant=variant)
    weights = initial_parameters(config, seed)
    network = make_policy_network(config)
    load_arrays(network, weights)
    with torch.no_grad():
        output = network(GraphBatch.from_observations(ObservationBatch.stack([observation]), config))
    decision = Policy(config, weights).decide(observation, greedy=True, rng=np.random.default_rng(0))
    joint = output.log_beacon.exp()[:, None] * output.log_waypoint.exp().view(len(output.log_beacon), -1)
    np.testing.assert_allclose(decision.waypoint_probabilities, joint.sum(0), atol=2e-5)
    best = int(observation.waypoint_nodes().tolist().index(decision.waypoint))
    assert joint.sum(0)[best] >= joint.sum(0).max() - 1e-5
    if variant != "vanilla":
        np.testing.assert_allclose(decision.beacon_probabilities, output.log_beacon.exp(), atol=2e-5)
        slot = observation.beacon_nodes().tolist().index(decision.beacon)
        assert joint[slot, best] >= joint[:, best].max() - 1e-5
        assert decision.log_probability == pytest.approx(joint[slot, best].log().item(), abs=1e-4)


def test_draws_follow_the_probabilities() -> None:
    observation = random_observation(np.random.default_rng(2), 12)
    policy = Policy.from_config(CONFIG)
    rng = np.random.default_rng(0)
    draws = [policy.decide(observation, greedy=False, rng=rng) for _ in range(2000)]
    for nodes, expected, drawn in (
        (observation.waypoint_nodes(), draws[0].waypoint_probabilities, [d.waypoint for d in draws]),
        (observation.beacon_nodes(), draws[0].beacon_probabilities, [d.beacon for d in draws]),
    ):
        counts = np.array([drawn.count(node) for node in nodes])
        assert counts.sum() == len(draws)
        np.testing.assert_allclose(counts / len(draws), expected, atol=0.05)


def test_vanilla_reports_the_nearest_beacon() -> None:
    observation = random_observation(np.random.default_rng(7), 40)
    policy = Policy.from_config(NetworkConfig(width=16, heads=2, layers=1, variant="vanilla"))
    decision = policy.decide(observation, greedy=False, rng=np.random.default_rng(0))
    distance = np.hypot(*observation.steps.T)
    assert distance[decision.beacon] == distance[observation.beacon_nodes()].min()


def test_no_choice_is_an_error() -> None:
    observation = random_observation(np.random.default_rng(1), 6)
    observation.beacon[:] = False
    with pytest.raises(ValueError, match="0 beacons"):
        Policy.from_config(CONFIG).decide(observation, greedy=True, rng=np.random.default_rng(0))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda w: w.pop("encoder.norm.bias"), "encoder.norm.bias .* missing"),
        (lambda w: w.update({"encoder.norm.bias": np.zeros(3, np.float32)}), "encoder.norm.bias: expected shape"),
        (lambda w: w.update({"encoder.norm.bias": np.zeros(16)}), "encoder.norm.bias: expected float32"),
        (lambda w: w["encoder.norm.bias"].fill(np.nan), "encoder.norm.bias holds values that are not finite"),
        (lambda w: w.update(extra=np.zeros(1, np.float32)), "extra is unknown"),
    ],
)
def test_wrong_weights_are_refused_and_the_old_ones_stay(spoil: object, message: str) -> None:
    policy = Policy.from_config(CONFIG)
    weights = initial_parameters(CONFIG, 1)
    spoil(weights)  # type: ignore[operator]
    with pytest.raises(WeightsError, match=message):
        policy.load(weights, version=5)
    assert policy.version == 0
    policy.load(initial_parameters(CONFIG, 1), version=5)
    assert policy.version == 5


def test_weights_survive_the_way_through_torch() -> None:
    weights = initial_parameters(CONFIG, 3)
    network = make_policy_network(CONFIG)
    load_arrays(network, weights)
    returned = to_arrays(network)
    assert all(np.array_equal(returned[name], weights[name]) for name in weights)
