"""The networks of the learned baselines: their shapes, choices and gradients, and that all that they read counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from pydantic import ValidationError

from common.config import NetworkConfig, RunConfig
from common.errors import WeightsError
from common.network.factory import make_policy_network
from common.network.graph_arrays import GraphArrays
from common.network.graph_batch import GraphBatch
from common.network.image_inference import place_tents
from common.network.parameters import initial_parameters, parameter_shapes, with_options
from common.network.segment import segment_sum
from common.network.state import to_arrays
from common.observations.feature_sets import FEATURE_NAMES
from common.observations.observation import ObservationBatch
from common.policies.policy import Policy
from tests.observations import random_batch, random_observation

SIZES = {"width": 16, "heads": 2, "layers": 2, "feedforward": 2}
CONFIGS = {
    "ariadne": NetworkConfig(variant="ariadne", features="ariadne", **SIZES),
    "ca": NetworkConfig(variant="ca", features="ca", graph="reduced", **SIZES),
    "cnn": NetworkConfig(variant="cnn", features="paper", **SIZES),
}


@pytest.mark.parametrize("name", CONFIGS)
def test_choices_are_the_waypoints_and_every_weight_learns(name: str) -> None:
    config = CONFIGS[name]
    torch.manual_seed(0)
    network = make_policy_network(config)
    assert {key: value.shape for key, value in to_arrays(network).items()} == parameter_shapes(config)
    assert initial_parameters(config, 0).keys() == parameter_shapes(config).keys()
    observations = random_batch(np.random.default_rng(0), 5, (2, 30), image=True)
    batch = GraphBatch.from_observations(observations, config)
    output = network(batch)
    assert not output.log_beacon.any()
    waypoints = [len(observations[k].waypoint_nodes()) for k in range(5)]
    assert np.diff(batch.arrays.pair_ptr).tolist() == waypoints
    total = segment_sum(output.log_waypoint.exp(), batch.pair_graph, 5)
    torch.testing.assert_close(total, torch.ones(5))
    # Observation 2 alone says what it said among the others.
    alone = GraphBatch.from_observations(observations.select(np.arange(5) == 2), config)
    torch.testing.assert_close(network(alone).log_waypoint, output.log_waypoint[batch.pair_graph == 2])
    output.log_waypoint.square().sum().backward()
    assert [key for key, value in network.named_parameters() if value.grad is None or not value.grad.any()] == []


@pytest.mark.parametrize("name", CONFIGS)
def test_a_lone_waypoint_is_certain(name: str) -> None:
    observation = random_observation(np.random.default_rng(3), 2, image=True)
    decision = Policy.from_config(CONFIGS[name]).decide(observation, greedy=False, rng=np.random.default_rng(0))
    assert decision.waypoint_probabilities.tolist() == [1.0]
    assert decision.beacon in observation.beacon_nodes()
    assert decision.waypoint == observation.waypoint_nodes()[0]


@pytest.mark.parametrize("name", ["ariadne", "ca"])
def test_nodes_have_the_features_of_the_publication(name: str) -> None:
    """Both sets are columns of the set `paper`, in which each has its test."""
    observations = random_batch(np.random.default_rng(1), 3)
    own = GraphArrays.from_observations(observations, CONFIGS[name].model_copy(update={"graph": "full"}))
    paper = GraphArrays.from_observations(observations, NetworkConfig(features="paper"))
    columns = [FEATURE_NAMES["paper"].index(feature) for feature in FEATURE_NAMES[name]]
    np.testing.assert_array_equal(own.features, paper.features[:, columns])
    assert ("target_distance" in FEATURE_NAMES[name]) == (name == "ca")


def test_images_decide_what_the_network_over_images_says() -> None:
    config = CONFIGS["cnn"]
    rng = np.random.default_rng(2)
    observation = random_observation(rng, 40, edge_share=1.0, image=True)
    assert observation.image is not None
    policy = Policy(config, {key: 3.0 * value for key, value in initial_parameters(config, 1).items()})

    def probabilities(changed: object) -> np.ndarray:
        return policy.decide(replace(observation, **changed), greedy=True, rng=rng).waypoint_probabilities

    before = probabilities({})
    for image in range(2):
        other = observation.image.copy()
        other[image] = 0
        assert np.abs(probabilities({"image": other}) - before).max() > 1e-4
    np.testing.assert_array_equal(probabilities({"utility": observation.utility + np.uint16(3)}), before)
    with pytest.raises(ValueError, match=r"these observations have none: observe with"):
        probabilities({"image": None})
    with pytest.raises(ValueError, match="1 of 2"):
        ObservationBatch.stack([observation, replace(observation, image=None)])


def test_waypoints_between_places_are_valued_between_them() -> None:
    steps = np.array([[1.0, -2.0], [0.25, 0.0], [-9.0, 1.5]], dtype=np.float32)
    tents = place_tents(steps)
    np.testing.assert_array_equal(tents[0], [[0, 0, 0, 1, 0], [1, 0, 0, 0, 0]])
    np.testing.assert_array_equal(tents[1], [[0, 0, 0.75, 0.25, 0], [0, 0, 1, 0, 0]])
    np.testing.assert_array_equal(tents[2], [[1, 0, 0, 0, 0], [0, 0, 0, 0.5, 0.5]])


def test_what_a_baseline_cannot_do_is_refused() -> None:
    for network in ({"variant": "cnn"}, {"variant": "ariadne", "features": "ariadne"}):
        with pytest.raises(ValidationError, match="is not told where a target is"):
            RunConfig.model_validate({"network": network, "task": {"name": "navigation"}})
        with pytest.raises(ValidationError, match="is not told where a target is"):
            RunConfig.model_validate({"network": network, "both_tasks": True})
    with pytest.raises(ValidationError, match="has none: unset it"):
        NetworkConfig(variant="ca", features="ca", toward=True)
    with pytest.raises(ValidationError, match="reads no route"):
        NetworkConfig(variant="cnn", features="guided")
    with pytest.raises(WeightsError, match=r"features 'ca' cannot go on with 'extended'"):
        with_options({}, CONFIGS["ca"], NetworkConfig())
