"""Policies as ONNX models: equal to the other two networks, and usable wherever a policy is."""

import dataclasses

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config import MappingConfig, NetworkConfig
from common.errors import CheckpointError, WeightsError
from common.network.factory import make_policy_network
from common.network.graph_arrays import GraphArrays
from common.network.graph_batch import GraphBatch
from common.network.inference import make_inference
from common.network.onnx_network import OnnxNetwork
from common.network.parameters import initial_parameters
from common.observations.observation import ObservationBatch
from common.policies.onnx_file import split
from common.policies.policy_file import PolicyCard, read_card, read_policy, write_card, write_onnx, write_policy
from common.system.extras import MissingPackageError
from learner.run.onnx_model import OPSET, onnx_model
from tests.observations import observations, random_observation

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

CONFIGS = {
    f"{variant}-{features}-{graph}": NetworkConfig(
        variant=variant, features=features, graph=graph, toward=graph == "tokens", width=16, heads=2, layers=2
    )
    for variant in ("vanilla", "hierarchical", "hdplanner")
    for features, graph in (("paper", "full"), ("extended", "full"), ("extended", "reduced"), ("guided", "tokens"))
} | {
    name: NetworkConfig(variant=name, features=features, graph=graph, width=16, heads=2, layers=2)
    for name, features, graph in (("ariadne", "ariadne", "full"), ("ca", "ca", "reduced"), ("cnn", "paper", "full"))
}
CONFIGS["beacon-attention"] = NetworkConfig(width=16, heads=2, layers=1, graph="reduced", beacon_attention=2)
CONFIGS["belief-map"] = NetworkConfig(width=16, heads=2, layers=1, graph="reduced", belief_map=True)
CONFIGS["detours"] = NetworkConfig(width=16, heads=2, layers=1, toward=True, detours=True)


def trained(config: NetworkConfig) -> dict[str, np.ndarray]:
    """Weights as after training: norms and biases are not ones and zeros any more."""
    rng = np.random.default_rng(5)
    arrays = initial_parameters(config, 3)
    return {
        name: (array + rng.normal(0.0, 0.2, array.shape)).astype(np.float32) if array.ndim == 1 else 1.5 * array
        for name, array in arrays.items()
    }


@pytest.fixture(scope="module")
def networks():
    """The three networks of every configuration."""
    made = {}
    for name, config in CONFIGS.items():
        arrays = trained(config)
        network = make_policy_network(config)
        network.load_state_dict({key: torch.from_numpy(array) for key, array in arrays.items()})
        made[name] = (network, make_inference(config, arrays), OnnxNetwork(onnx_model(config, arrays)))
    return made


@settings(max_examples=30)
@given(observation=observations(60, image=True))
def test_all_three_networks_say_the_same(networks, observation):
    """Each observation, of which drawing takes longest, is for the networks of all configurations."""
    for name, (through_torch, through_numpy, through_onnx) in networks.items():
        graph = GraphArrays.from_observations(ObservationBatch.stack([observation]), CONFIGS[name])
        log_beacon, log_waypoint = through_onnx(graph)
        with torch.inference_mode():
            expected = through_torch(GraphBatch.from_arrays(graph))
        for beacon, waypoint in (
            (expected.log_beacon.numpy(), expected.log_waypoint.numpy().reshape(log_waypoint.shape)),
            through_numpy(graph),
        ):
            np.testing.assert_allclose(log_beacon, beacon, atol=1e-4, err_msg=name)
            np.testing.assert_allclose(log_waypoint, waypoint, atol=1e-4, err_msg=name)


def test_the_model_is_plain_onnx(networks):
    model = onnx.load_from_string(
        onnx_model(CONFIGS["hdplanner-extended-full"], trained(CONFIGS["hdplanner-extended-full"]))
    )
    assert [entry.version for entry in model.opset_import] == [OPSET]
    assert {node.domain for node in model.graph.node} == {""}, "no operators of one runtime alone"
    assert [each.name for each in model.graph.input] == ["features", "neighbours", "robot", "beacons", "waypoints"]


CARD = PolicyCard(
    run="office",
    task="exploration",
    network=CONFIGS["hdplanner-extended-full"],
    mapping=MappingConfig(),
    version=12,
    updates=3400,
    steps=900,
    averaged=True,
    commit="abc",
    created="2026-01-02T03:04:05",
)


def test_a_policy_of_an_onnx_file_decides_as_that_of_a_safetensors_file(tmp_path):
    arrays = trained(CARD.network)
    write_policy(tmp_path / "a.safetensors", arrays, CARD)
    write_onnx(tmp_path / "a.onnx", onnx_model(CARD.network, arrays), CARD)
    (one, _), (other, card) = read_policy(tmp_path / "a.safetensors"), read_policy(tmp_path / "a.onnx")
    assert card == CARD
    assert other.version == 12
    rng = np.random.default_rng(0)
    for viewpoints in (2, 5, 40, 200):
        observation = random_observation(rng, viewpoints, "known", edge_share=1.0)
        for greedy in (True, False):
            decisions = [
                policy.decide(observation, greedy=greedy, rng=np.random.default_rng(1)) for policy in (one, other)
            ]
            assert decisions[0].waypoint == decisions[1].waypoint
            assert decisions[0].beacon == decisions[1].beacon
            np.testing.assert_allclose(
                decisions[0].waypoint_probabilities, decisions[1].waypoint_probabilities, atol=1e-5
            )


def test_new_weights_replace_those_of_the_file(tmp_path):
    write_onnx(tmp_path / "a.onnx", onnx_model(CARD.network, trained(CARD.network)), CARD)
    policy, _ = read_policy(tmp_path / "a.onnx")
    with pytest.raises(WeightsError):
        policy.load({}, 13)
    assert policy.version == 12
    policy.load(initial_parameters(CARD.network, 1), 13)
    assert policy.version == 13


def test_the_card_of_an_onnx_file_can_be_replaced(tmp_path):
    path = tmp_path / "a.onnx"
    write_onnx(path, onnx_model(CARD.network, trained(CARD.network)), CARD)
    before = split(path.read_bytes())[0]
    noted = dataclasses.replace(CARD, bench={"hdplanner": {"distance": 600.0}})
    write_card(path, noted)
    assert read_card(path) == noted
    assert split(path.read_bytes())[0] == before
    assert [file.name for file in tmp_path.iterdir()] == ["a.onnx"]


def test_damaged_files_are_refused(tmp_path):
    path = tmp_path / "a.onnx"
    write_onnx(path, onnx_model(CARD.network, trained(CARD.network)), CARD)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(bytes(data))
    with pytest.raises(CheckpointError, match="damaged"):
        read_policy(path)
    path.write_bytes(bytes(data[: len(data) // 2]))
    with pytest.raises(CheckpointError, match="damaged"):
        read_policy(path)
    with pytest.raises(CheckpointError, match="cannot read"):
        read_policy(tmp_path / "absent.onnx")
    with pytest.raises(CheckpointError, match="must end in"):
        write_onnx(tmp_path / "a.bin", b"", CARD)


def test_a_model_of_something_else_is_refused(tmp_path):
    write_onnx(tmp_path / "a.onnx", b"\x08\x08", CARD)
    with pytest.raises(CheckpointError, match="cannot run this model"):
        read_policy(tmp_path / "a.onnx")


def test_a_model_of_a_fixed_number_of_neighbours_is_refused_with_advice(tmp_path):
    """As exports were before viewpoints could have more than 20 neighbours."""
    model = onnx.load_from_string(onnx_model(CARD.network, trained(CARD.network)))
    (neighbours,) = (each for each in model.graph.input if each.name == "neighbours")
    neighbours.type.tensor_type.shape.dim[1].dim_value = 22
    write_onnx(tmp_path / "a.onnx", model.SerializeToString(), CARD)
    with pytest.raises(CheckpointError, match=r"earlier release.* 20 neighbours at most: export the policy again"):
        read_policy(tmp_path / "a.onnx")


def test_without_onnxruntime_it_says_what_to_install(tmp_path, monkeypatch):
    write_onnx(tmp_path / "a.onnx", onnx_model(CARD.network, trained(CARD.network)), CARD)
    monkeypatch.setitem(__import__("sys").modules, "onnxruntime", None)
    with pytest.raises(MissingPackageError, match=r"\[onnx\]"):
        read_policy(tmp_path / "a.onnx")
    assert read_card(tmp_path / "a.onnx") == CARD, "the card needs no runtime"


@pytest.mark.slow
@settings(max_examples=150)
@given(st.integers(0, 2**31), st.integers(2, 250), st.sampled_from(["none", "unknown", "known"]))
def test_sizes_of_the_paper_agree_too(paper_networks, seed, viewpoints, target):
    through_numpy, through_onnx, config = paper_networks
    observation = random_observation(np.random.default_rng(seed), viewpoints, target)
    graph = GraphArrays.from_observations(ObservationBatch.stack([observation]), config)
    for one, other in zip(through_numpy(graph), through_onnx(graph), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-4)


@pytest.fixture(scope="module")
def paper_networks():
    config = NetworkConfig()
    arrays = initial_parameters(config, 0)
    return make_inference(config, arrays), OnnxNetwork(onnx_model(config, arrays)), config
