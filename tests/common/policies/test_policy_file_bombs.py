"""Policies and cards that are made to cost: one sentence each, at once."""

import json
import time

import pytest

from common.errors import CheckpointError
from common.policies import onnx_file
from common.policies.policy_file import card_path, read_policy


@pytest.mark.parametrize(
    "card", ["[" * 500_000, '{"a":' * 2000 + "1" + "}" * 2000, '{"format": 1e999}', " " * (1 << 21), "{}", "7"]
)
def test_hostile_cards_are_refused_at_once(tmp_path, card):
    path = tmp_path / "policy.safetensors"
    path.write_bytes(b"weights")
    card_path(path).write_text(card)
    began = time.monotonic()
    with pytest.raises(CheckpointError) as caught:
        read_policy(path)
    assert "\n" not in str(caught.value)
    assert time.monotonic() - began < 1.0


def test_a_policy_without_end_is_not_read(tmp_path):
    path = tmp_path / "policy.safetensors"
    with path.open("wb") as file:
        file.truncate(1 << 40)
    card_path(path).write_text(json.dumps({"format": 1, "sha256": ""}))
    with pytest.raises(CheckpointError, match="no policy: it has more than"):
        read_policy(path)


@pytest.mark.parametrize(
    "data",
    [
        bytes([8, 0]) * 10_000_000,
        onnx_file._field(onnx_file._METADATA, bytes([8, 0]) * 400_000) * 20,
        onnx_file._field(onnx_file._METADATA, b"x" * (1 << 22)),
    ],
    ids=["fields", "fields of entries", "a long entry"],
)
def test_models_of_fields_without_end_are_refused_at_once(data):
    began = time.monotonic()
    with pytest.raises(CheckpointError):
        onnx_file.split(data)
    assert time.monotonic() - began < 1.0
