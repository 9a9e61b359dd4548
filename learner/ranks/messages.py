"""What rank 0 tells the others through their standard input: length and msgpack, each message one frame."""

from __future__ import annotations

import dataclasses
import json
import struct
from typing import Any, BinaryIO, TypeVar

import numpy as np
import torch

from common.messages.codec import pack, unpack
from common.messages.experience import ExpertLabels
from common.observations.observation import ObservationBatch
from learner.algorithm.batch import TransitionBatch

MAX_FRAME = 1 << 31
_LENGTH = struct.Struct("<Q")

T = TypeVar("T")


def frame(kind: str, **fields: Any) -> bytes:
    """Return the bytes of a message, see `common.messages.codec.pack` for what its fields may be."""
    body = pack({"kind": kind, **fields})
    return _LENGTH.pack(len(body)) + body


def read_frame(stream: BinaryIO) -> dict[str, Any] | None:
    """Wait for the next message and return its fields, its kind among them; None at the end of the stream.

    Raises:
        MessageError: the bytes are no message.
    """
    head = stream.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        return None
    (length,) = _LENGTH.unpack(head)
    body = stream.read(length)
    return None if len(body) < length else unpack(body, "rank", MAX_FRAME)


def batch_fields(batch: TransitionBatch) -> dict[str, Any]:
    """Return a batch as fields of a message."""
    return _fields(batch)


def read_batch(fields: dict[str, Any]) -> TransitionBatch:
    """Return the batch of `batch_fields`."""
    parts: dict[str, type[Any]] = {
        "observations": ObservationBatch,
        "next_observations": ObservationBatch,
        "labels": ExpertLabels,
        "next_labels": ExpertLabels,
    }
    made = {name: parts[name](**value) if isinstance(value, dict) else value for name, value in fields.items()}
    return TransitionBatch(**made)


def state_fields(tensors: dict[str, torch.Tensor], values: dict[str, Any]) -> dict[str, Any]:
    """Return a learner's state, see `Algorithm.state`, as fields of a message."""
    return {"tensors": {name: value.numpy() for name, value in tensors.items()}, "values": json.dumps(values)}


def read_state(fields: dict[str, Any]) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
    """Return the state of `state_fields`."""
    tensors = {name: torch.from_numpy(np.asarray(value)) for name, value in fields["tensors"].items()}
    return tensors, json.loads(fields["values"])


def _fields(record: Any) -> dict[str, Any]:
    values = {field.name: getattr(record, field.name) for field in dataclasses.fields(record)}
    return {name: _fields(value) if dataclasses.is_dataclass(value) else value for name, value in values.items()}
