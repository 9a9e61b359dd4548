"""Policies whose files are not what they should be: one sentence that names the file, what is wrong and what to do."""

import hashlib
import json
import struct
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save

from common.config import MappingConfig, NetworkConfig
from common.errors import CheckpointError, WeightsError
from common.network.parameters import initial_parameters
from common.policies.policy_file import PolicyCard, card_path, read_policy, read_weights, write_policy

NETWORK = NetworkConfig(width=16, heads=2, layers=1)
POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 3\n"


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "policy.safetensors"
    card = PolicyCard("test", "exploration", NETWORK, MappingConfig(), 1, 0, 0, False, "abc", "now")
    write_policy(path, initial_parameters(NETWORK, 0), card)
    return path


def change_card(path, change):
    values = json.loads(card_path(path).read_text())
    change(values)
    card_path(path).write_text(json.dumps(values))


def write_weights(path, data):
    path.write_bytes(data)
    change_card(path, lambda card: card.update(sha256=hashlib.sha256(data).hexdigest()))


def test_a_policy_at_a_url_is_to_be_fetched_first():
    with pytest.raises(
        CheckpointError, match=r"has to lie on this machine: fetch it from there, with its card office.json"
    ):
        read_policy(Path("s3://bucket/office.safetensors"))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda card: card.pop("format"), "policy.json is no card of a policy"),
        (lambda card: card.pop("task"), "policy.json .*: task is missing: export the policy again"),
        (lambda card: card.pop("network"), "policy.json .*: network is missing"),
        (lambda card: card.update(novel=1), "policy.json .*: novel is unknown here: use the release that made it"),
        (lambda card: card["network"].update(novel=1), "policy.json .*: network.novel is unknown here"),
        (lambda card: card.update(task=5), "policy.json .*: task: .*, got '5'"),
        (lambda card: card.update(maps="generator:rooms"), "policy.json .*: maps: .*, got 'generator:rooms'"),
        (lambda card: card.update(ranges={"x": 5}), "policy.json .*: ranges.x: .*, got '5'"),
        (lambda card: card.update(format="1"), "policy.json has format '1'"),
    ],
)
def test_a_card_of_another_release_is_told_field_by_field(path, change, words):
    change_card(path, change)
    with pytest.raises(CheckpointError, match=words) as caught:
        read_policy(path)
    assert "\n" not in str(caught.value)


def test_what_lies_in_the_place_of_a_policy_or_its_card_is_told(path):
    card = card_path(path).read_bytes()
    card_path(path).write_bytes(POINTER)
    with pytest.raises(CheckpointError, match="its card policy.json is a pointer of Git LFS"):
        read_policy(path)
    card_path(path).write_bytes(card)
    path.write_bytes(POINTER)
    with pytest.raises(CheckpointError, match=r"policy.safetensors: it is a pointer of Git LFS"):
        read_policy(path)
    onnx = path.with_suffix(".onnx")
    onnx.write_bytes(b"no model")
    with pytest.raises(CheckpointError, match=r"policy.onnx: this is no ONNX model"):
        read_policy(onnx)
    with pytest.raises(CheckpointError, match="expected a file ending in .safetensors or .onnx, got 'policy.json'"):
        read_policy(card_path(path))


@pytest.mark.parametrize("read", [read_policy, read_weights])
def test_weights_of_a_type_that_numpy_lacks_are_named(path, read):
    header = json.dumps({"w": {"dtype": "BF16", "shape": [1], "data_offsets": [0, 2]}}).encode()
    write_weights(path, struct.pack("<Q", len(header)) + header + b"\0\0")
    with pytest.raises(CheckpointError, match="policy.safetensors: expected weights of float32, got BF16"):
        read(path)


def test_weights_of_another_network_are_told_with_their_file(path):
    write_weights(path, save({"w": np.zeros(1, np.float32)}))
    with pytest.raises(WeightsError, match="policy.safetensors: weight .* is missing"):
        read_policy(path)
