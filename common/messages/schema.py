"""Every kind of message: its name on the wire, its longest form, how it is written and how it is read."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar, overload

from common.errors import MessageError
from common.messages.codec import pack, unpack
from common.messages.experience import Delivery
from common.messages.fields import MAX_INCARNATION, Fields
from common.messages.replies import ALL_VERBS, PROTOCOL_VERSION, Ack, ControlReply, ControlRequest, Spec
from common.messages.stats import ActorStats, LearnerStats
from common.messages.view import EpisodeView, read_view, view_fields
from common.messages.weights import FLOATS, MAX_WEIGHTS, Weights, WeightsNotice
from common.system.printable import printable, printable_tree

T = TypeVar("T")
U = TypeVar("U")

MAX_SMALL = 1 << 20
MAX_DELIVERY = 1 << 26
MAX_HOLD = 60.0
MAX_PID = 2**32
MAX_RATE = 1e6
MAX_AGE = 1e9


@dataclass(frozen=True, slots=True)
class _Kind(Generic[T]):
    """How one kind of message travels."""

    name: str
    write: Callable[[T], dict[str, Any]]
    read: Callable[[Fields], T]
    max_bytes: int = MAX_SMALL


def encode(message: object) -> bytes:
    """Return the bytes of a message.

    Args:
        message: a Delivery, Ack, Spec, WeightsNotice, Weights, ActorStats, LearnerStats, EpisodeView, ControlRequest
            or ControlReply.

    Raises:
        TypeError: for anything else, or a field that no message can hold.
    """
    kind = _KINDS.get(type(message))
    if kind is None:
        names = ", ".join(known.__name__ for known in _KINDS)
        raise TypeError(f"must be one of {names}, got {type(message).__name__}")
    return pack({"v": PROTOCOL_VERSION, "kind": kind.name, **kind.write(message)})


@overload
def decode(data: bytes, expected: type[T], /) -> T: ...
@overload
def decode(data: bytes, expected: type[T], other: type[U], /) -> T | U: ...
def decode(data: bytes, *expected: type[Any]) -> Any:
    """Read and check a message that may come from anywhere.

    Args:
        data: the bytes.
        expected: the messages that may come here.

    Returns:
        The message; its arrays own their memory.

    Raises:
        MessageError: naming the field, what was expected and what came.
    """
    kinds = [_KINDS[wanted] for wanted in expected]
    path = kinds[0].name
    fields = Fields(unpack(data, path, max(kind.max_bytes for kind in kinds)), path)
    version = fields.integer("v")
    if version != PROTOCOL_VERSION:
        # Whoever sent it may read this as well, in the answer: it must hold on either side.
        age = "a newer" if version > PROTOCOL_VERSION else "an older"
        fields.fail(
            "v",
            f"must be {PROTOCOL_VERSION}, the protocol of the reader, got {version}: the sender has {age} release; "
            "install the same release on every machine of the run",
        )
    name = fields.word("kind", *(kind.name for kind in kinds))
    kind = next(kind for kind in kinds if kind.name == name)
    if len(data) > kind.max_bytes:
        raise MessageError(name, f"must have at most {kind.max_bytes} bytes, got {len(data)}")
    fields.path = name
    message = kind.read(fields)
    fields.finish()
    return message


NO_MESSAGE = "a message that is none"
"""What `describe_delivery` says of bytes that tell nothing."""


def describe_delivery(data: bytes) -> str:
    """Say whose delivery some bytes are, as far as they tell, for the log: they may be no valid message."""
    try:
        fields = unpack(data, "delivery", MAX_DELIVERY)
    except MessageError:
        return NO_MESSAGE
    actor, incarnation, sequence = (fields.get(name) for name in ("actor", "incarnation", "sequence"))
    return printable(f"message {sequence!r:.30} of {actor!r:.70} (incarnation {incarnation!r:.30})")


def _plain(message: Any) -> dict[str, Any]:
    return {field.name: getattr(message, field.name) for field in dataclasses.fields(message)}


# Deliveries are checked by compiled kernels. Importing those takes half a second, which whoever sends and reads other
# messages, such as a command or a page, need not wait for.


def _delivery_fields(delivery: Delivery) -> dict[str, Any]:
    from common.messages.experience_codec import delivery_fields

    return delivery_fields(delivery)


def _read_delivery(fields: Fields) -> Delivery:
    from common.messages.experience_codec import read_delivery

    return read_delivery(fields)


def _read_ack(fields: Fields) -> Ack:
    return Ack(
        sequence=fields.integer("sequence", -1),
        stored=fields.flag("stored"),
        hold=fields.number("hold", 0.0, MAX_HOLD),
        error=fields.prose("error", 1000),
        learner=fields.integer("learner", 0, MAX_INCARNATION),
    )


def _read_spec(fields: Fields) -> Spec:
    return Spec(
        run=fields.identifier("run"),
        learner=fields.integer("learner", 0, MAX_INCARNATION),
        config=fields.json_text("config", MAX_SMALL),
    )


def _read_notice(fields: Fields) -> WeightsNotice:
    return WeightsNotice(
        learner=fields.integer("learner", 0, MAX_INCARNATION),
        version=fields.integer("version"),
        updates=fields.integer("updates"),
        averaged=fields.flag("averaged"),
        bytes=fields.integer("bytes", 0, MAX_WEIGHTS),
        digest=fields.digest("digest"),
    )


def _write_weights(weights: Weights) -> dict[str, Any]:
    return {**_plain(weights), "tensors": dict(weights.tensors)}


def _read_weights(fields: Fields) -> Weights:
    inner = fields.fields("tensors")
    tensors = inner.rest()
    for name, tensor in tensors.items():
        dtype = getattr(getattr(tensor, "dtype", None), "name", type(tensor).__name__)
        if dtype not in FLOATS:
            inner.fail(name, f"must be an array of {', '.join(FLOATS)}, got {dtype}")
    weights = Weights(
        learner=fields.integer("learner", 0, MAX_INCARNATION),
        version=fields.integer("version"),
        updates=fields.integer("updates"),
        averaged=fields.flag("averaged"),
        tensors=tensors,
        digest=fields.digest("digest"),
    )
    weights.check(fields.path)
    return weights


def _read_actor_stats(fields: Fields) -> ActorStats:
    return ActorStats(
        actor=fields.identifier("actor"),
        host=fields.text("host"),
        pid=fields.integer("pid", 0, MAX_PID),
        steps=fields.integer("steps"),
        episodes=fields.integer("episodes"),
        steps_per_second=fields.number("steps_per_second", 0.0, MAX_RATE),
        version=fields.integer("version", -1),
        version_age=fields.number("version_age", 0.0, MAX_AGE),
        buffered=fields.integer("buffered"),
        state=fields.text("state"),
        # Actors of earlier releases do not tell these.
        restarts=fields.integer("restarts") if fields.has("restarts") else 0,
        last_error=fields.text("last_error") if fields.has("last_error") else "",
    )


def _read_learner_stats(fields: Fields) -> LearnerStats:
    return LearnerStats(
        host=fields.text("host"),
        pid=fields.integer("pid", 0, MAX_PID),
        steps=fields.integer("steps"),
        episodes=fields.integer("episodes"),
        updates=fields.integer("updates"),
        version=fields.integer("version", -1),
        steps_per_second=fields.number("steps_per_second", 0.0, MAX_RATE),
        updates_per_second=fields.number("updates_per_second", 0.0, MAX_RATE),
        replay=fields.integer("replay"),
        state=fields.text("state"),
    )


def _write_request(request: ControlRequest) -> dict[str, Any]:
    return {"verb": request.verb, "arguments": _json(request.arguments)}


def _read_request(fields: Fields) -> ControlRequest:
    return ControlRequest(verb=fields.word("verb", *ALL_VERBS), arguments=fields.document("arguments"))


def _write_reply(reply: ControlReply) -> dict[str, Any]:
    return {"ok": reply.ok, "error": reply.error, "body": _json(reply.body)}


def _read_reply(fields: Fields) -> ControlReply:
    # People read it in a terminal, and whoever answers may be a stranger.
    body = printable_tree(fields.document("body"))
    return ControlReply(ok=fields.flag("ok"), error=fields.prose("error", 1000), body=body)


def _json(value: Mapping[str, Any]) -> str:
    return json.dumps(value, allow_nan=False)


_KINDS: dict[type[Any], _Kind[Any]] = {
    Delivery: _Kind("delivery", _delivery_fields, _read_delivery, MAX_DELIVERY),
    Ack: _Kind("ack", _plain, _read_ack),
    Spec: _Kind("spec", _plain, _read_spec),
    WeightsNotice: _Kind("weights_notice", _plain, _read_notice),
    Weights: _Kind("weights", _write_weights, _read_weights, MAX_WEIGHTS),
    ActorStats: _Kind("actor_stats", _plain, _read_actor_stats),
    LearnerStats: _Kind("learner_stats", _plain, _read_learner_stats),
    EpisodeView: _Kind("episode_view", view_fields, read_view),
    ControlRequest: _Kind("control_request", _write_request, _read_request),
    ControlReply: _Kind("control_reply", _write_reply, _read_reply),
}
