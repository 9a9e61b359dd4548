"""A policy as files: weights as safetensors beside a card in JSON that says what they are and where they come from."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError
from safetensors import SafetensorError
from safetensors.numpy import load as load_tensors
from safetensors.numpy import save as save_tensors

from common.config.schema import MappingConfig, NetworkConfig
from common.errors import CheckpointError
from common.policy import Policy

FORMAT = 1


@dataclass(frozen=True, slots=True)
class PolicyCard:
    """What a policy is, and where it comes from.

    Attributes:
        run: name of the run that trained it.
        task: ``exploration`` or ``navigation``.
        network: its sizes, variant and features.
        mapping: the belief and the graph that it was trained on.
        version: policy version.
        updates: updates behind it.
        steps: collected steps behind it.
        averaged: the weights are the moving average of training.
        commit: of the training code, or a word saying that it is unknown.
        created: local time, ISO 8601.
        evaluation: means over a complete round of evaluation, None when it was not evaluated.
    """

    run: str
    task: str
    network: NetworkConfig
    mapping: MappingConfig
    version: int
    updates: int
    steps: int
    averaged: bool
    commit: str
    created: str
    evaluation: dict[str, float] | None = None


def card_path(path: Path) -> Path:
    """Path of the card that belongs to the weights in ``path``."""
    return path.with_suffix(".json")


def write_policy(path: Path, arrays: dict[str, NDArray[Any]], card: PolicyCard) -> None:
    """Write `<name>.safetensors` and `<name>.json`.

    Raises:
        CheckpointError: when the suffix is another one, or the files cannot be written.
    """
    if path.suffix != ".safetensors":
        raise CheckpointError(f"a policy's file must end in .safetensors, got {path.name!r}")
    data = save_tensors({name: np.ascontiguousarray(array) for name, array in arrays.items()})
    values = asdict(card) | {"network": card.network.model_dump(), "mapping": card.mapping.model_dump()}
    text = json.dumps({"format": FORMAT, "sha256": hashlib.sha256(data).hexdigest(), **values}, indent=2) + "\n"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        for target, content in ((path, data), (card_path(path), text.encode())):
            temporary = target.with_name(f".{target.name}.tmp")
            temporary.write_bytes(content)
            temporary.replace(target)
    except OSError as error:
        raise CheckpointError(f"cannot write the policy {path}: {error}") from error


def read_policy(path: Path) -> tuple[Policy, PolicyCard]:
    """Read a policy that `write_policy` wrote, ready to act.

    Raises:
        CheckpointError: when a file is missing, damaged or of another format.
        WeightsError: when the weights do not fit the network of the card.
    """
    try:
        data = path.read_bytes()
        values = json.loads(card_path(path).read_text("utf-8"))
        written, digest = values.pop("format"), values.pop("sha256")
        if written != FORMAT:
            raise CheckpointError(f"{card_path(path)} has format {written}, this software reads format {FORMAT}")
        if hashlib.sha256(data).hexdigest() != digest:
            raise CheckpointError(f"{path} is damaged, or not the file that {card_path(path).name} describes")
        network = NetworkConfig.model_validate(values.pop("network"))
        mapping = MappingConfig.model_validate(values.pop("mapping"))
        card = PolicyCard(network=network, mapping=mapping, **values)
        arrays = load_tensors(data)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, ValidationError, SafetensorError) as error:
        raise CheckpointError(f"cannot read the policy {path} with its card: {error}") from error
    return Policy(network, arrays, card.version), card
