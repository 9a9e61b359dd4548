"""A policy as files: weights, and a card in JSON that says what they are and where they come from.

Weights lie in `<name>.safetensors` beside `<name>.json`, or card and network together in `<name>.onnx`.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, TypeAdapter, ValidationError
from safetensors import SafetensorError
from safetensors.numpy import load as load_tensors
from safetensors.numpy import save as save_tensors

from common.config import MappingConfig, NetworkConfig
from common.errors import CheckpointError, WeightsError
from common.extensions import GENERATOR_PREFIX
from common.network.onnx_network import OnnxNetwork
from common.policies import onnx_file
from common.policies.policy import Policy
from common.problems import first_problem
from common.system.documents import DocumentError, parse_json, read_text
from common.system.stand_ins import stand_in
from common.tasks import BOTH

FORMAT = 1
SUFFIX = ".safetensors"
MAX_BYTES = 1 << 28
"""Largest policy, as on the bus."""


@dataclass(frozen=True, slots=True)
class PolicyCard:
    """What a policy is, and where it comes from.

    Attributes:
        run: name of the run that trained it.
        task: ``exploration``, ``navigation`` or ``both``.
        network: its sizes, variant and features.
        mapping: the belief and the graph that it was trained on.
        version: policy version.
        updates: updates behind it.
        steps: collected steps behind it.
        averaged: the weights are the moving average of training.
        commit: of the training code, or a word saying that it is unknown.
        created: local time, ISO 8601.
        evaluation: means over a complete round of evaluation, None when it was not evaluated.
        maps: sources of the training worlds.
        ranges: bounds of what training drew anew for each episode, by the setting of `mapping`; empty for old ones.
        seed: of the run.
        wall_seconds: time that the learner ran for it, seconds.
        licence: of the weights, an SPDX identifier.
        bench: figures on benchmark maps by planner name, as `hd-eval card` notes them.
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
    maps: tuple[str, ...] = ()
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    seed: int = 0
    wall_seconds: float = 0.0
    licence: str = "Apache-2.0"
    bench: dict[str, dict[str, float]] | None = None

    __pydantic_config__ = ConfigDict(extra="forbid")

    @property
    def tasks(self) -> frozenset[str]:
        """The tasks that it was trained for."""
        return frozenset(task.name for task in BOTH) if self.task == "both" else frozenset({self.task})


def card_from(values: Mapping[str, Any]) -> PolicyCard:
    """Make a card from plain values, as JSON holds them; CheckpointError when they are none."""
    try:
        return _cards().validate_python(values)
    except ValidationError as error:
        first = first_problem(error)
        if first.kind in ("unexpected_keyword_argument", "extra_forbidden"):
            raise CheckpointError(f"{first.path} is unknown here: use the release that made it") from None
        if first.kind in ("missing", "missing_argument"):
            raise CheckpointError(f"{first.path} is missing: export the policy again") from None
        raise CheckpointError(f"{first.path}: {first.words}, got {str(first.given)[:60]!r}: correct it") from None


@functools.cache
def _cards() -> TypeAdapter[PolicyCard]:
    return TypeAdapter(PolicyCard)


def card_path(path: Path) -> Path:
    """Path of the card that belongs to the weights in ``path``."""
    return path.with_suffix(".json")


def portable_sources(specs: Iterable[str]) -> tuple[str, ...]:
    """Return map sources as a card tells them: of a folder's path only the last two parts, generators in full."""
    return tuple(spec if spec.startswith(GENERATOR_PREFIX) else "/".join(Path(spec).parts[-2:]) for spec in specs)


def write_policy(path: Path, arrays: dict[str, NDArray[Any]], card: PolicyCard) -> None:
    """Write `<name>.safetensors` and `<name>.json`.

    Raises:
        CheckpointError: when the suffix is another one, or the files cannot be written.
    """
    if path.suffix != SUFFIX:
        raise CheckpointError(f"a policy's file must end in {SUFFIX}, got {path.name!r}")
    data = save_tensors({name: np.ascontiguousarray(array) for name, array in arrays.items()})
    _write(path, data)
    _write(card_path(path), _card_text(card, data))


def write_onnx(path: Path, model: bytes, card: PolicyCard) -> None:
    """Write `<name>.onnx`, which carries its card.

    Args:
        path: file to write.
        model: a serialised ONNX model, as `learner.run.onnx_model` makes it.
        card: what it is.

    Raises:
        CheckpointError: when the suffix is another one, or the file cannot be written.
    """
    if path.suffix != onnx_file.SUFFIX:
        raise CheckpointError(f"an ONNX policy's file must end in {onnx_file.SUFFIX}, got {path.name!r}")
    _write(path, onnx_file.with_card(model, _card_text(card, model).decode()))


def read_card(path: Path) -> PolicyCard:
    """Read the card of the policy in ``path``.

    Raises:
        CheckpointError: when it is missing, damaged or of another format.
    """
    return _read(path)[0]


def write_card(path: Path, card: PolicyCard) -> None:
    """Replace the card of the policy in ``path``, whose weights stay as they are.

    Raises:
        CheckpointError: when the policy cannot be read, or the card not be written.
    """
    _, data = _read(path)
    if path.suffix == onnx_file.SUFFIX:
        write_onnx(path, data, card)
    else:
        _write(card_path(path), _card_text(card, data))


def read_policy(path: Path) -> tuple[Policy, PolicyCard]:
    """Read a policy that `write_policy` or `write_onnx` wrote, ready to act.

    Raises:
        CheckpointError: when a file is missing, damaged or of another format, or onnxruntime is not installed.
        WeightsError: when the weights do not fit the network of the card.
    """
    card, data = _read(path)
    try:
        if path.suffix == onnx_file.SUFFIX:
            return Policy.with_network(card.network, OnnxNetwork(data), card.version), card
        return Policy(card.network, _tensors(path, data), card.version), card
    except WeightsError as error:
        raise WeightsError(f"{path}: {error}") from None


def read_weights(path: Path) -> tuple[dict[str, NDArray[Any]], PolicyCard]:
    """Read the weights that `write_policy` wrote, to train on from there.

    Raises:
        CheckpointError: when a file is missing, damaged or of another format, or holds an ONNX model.
    """
    if path.suffix != SUFFIX:
        raise CheckpointError(f"training continues only from a {SUFFIX} file, got {path.name!r}")
    card, data = _read(path)
    return _tensors(path, data), card


def _tensors(path: Path, data: bytes) -> dict[str, NDArray[Any]]:
    try:
        return load_tensors(data)
    except SafetensorError as error:
        raise CheckpointError(f"cannot read the policy {path}: {error}; copy or export it again") from error
    except KeyError as error:
        # NumPy has no such type.
        raise CheckpointError(
            f"cannot read the policy {path}: expected weights of float32, got {error.args[0]}: convert them"
        ) from error


def _read(path: Path) -> tuple[PolicyCard, bytes]:
    """Return the card and the bytes that it describes: of the weights, or of the ONNX model without its card."""
    if path.suffix not in (SUFFIX, onnx_file.SUFFIX):
        raise CheckpointError(
            f"cannot read the policy {path}: expected a file ending in {SUFFIX} or {onnx_file.SUFFIX}, got "
            f"{path.name!r}: name the weights, as `hd-learner export` writes them"
        )
    try:
        if path.stat().st_size > MAX_BYTES:
            raise CheckpointError(f"{path} is no policy: it has more than {MAX_BYTES:,} bytes")
        data = path.read_bytes()
        if instead := stand_in(data):
            raise CheckpointError(f"cannot read the policy {path}: it {instead}")
        if path.suffix == onnx_file.SUFFIX:
            where = path
            data, text = onnx_file.split(data)
        else:
            where = card_path(path)
            text = read_text(where)
        values = parse_json(text)
    except FileNotFoundError as error:
        # A path has one slash left of the two of a URL.
        if re.match(r"[a-z0-9+]{2,}:/", str(path)):
            raise CheckpointError(
                f"cannot read the policy {path}: it has to lie on this machine: fetch it from there, with its card "
                f"{card_path(path).name}"
            ) from None
        raise CheckpointError(
            f"cannot read the policy {path} with its card: there is no file {error.filename}: check the path, and keep "
            "weights and card together"
        ) from None
    except DocumentError as error:
        raise CheckpointError(f"cannot read the policy {path}: its card {card_path(path).name} {error}") from None
    except (OSError, ValueError) as error:
        raise CheckpointError(f"cannot read the policy {path} with its card: {error}") from error
    except CheckpointError as error:
        raise CheckpointError(
            str(error) if str(path) in str(error) else f"cannot read the policy {path}: {error}"
        ) from None
    if not isinstance(values, dict) or not {"format", "sha256"} <= set(values):
        raise CheckpointError(
            f"{where} is no card of a policy: expected a table of fields, with format and sha256 among them: copy or "
            "export it again"
        )
    written, digest = values.pop("format"), values.pop("sha256")
    if written != FORMAT:
        raise CheckpointError(f"{where} has format {written!r}, this software reads format {FORMAT}: use that release")
    if hashlib.sha256(data).hexdigest() != digest:
        raise CheckpointError(
            f"{path} is damaged, or not the file that the card in {where.name} describes: copy both again"
        )
    try:
        return card_from(values), data
    except CheckpointError as error:
        raise CheckpointError(f"{where} is no card of this release: {error}") from None


def _card_text(card: PolicyCard, data: bytes) -> bytes:
    values = asdict(card) | {"network": card.network.model_dump(), "mapping": card.mapping.model_dump()}
    text = json.dumps({"format": FORMAT, "sha256": hashlib.sha256(data).hexdigest(), **values}, indent=2) + "\n"
    return text.encode()


def _write(target: Path, content: bytes) -> None:
    """Write a file that readers see whole or not at all."""
    temporary = target.with_name(f".{target.name}.tmp")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_bytes(content)
        temporary.replace(target)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise CheckpointError(f"cannot write the policy {target}: {error}") from error
