"""ONNX files that carry their card: standard models whose metadata holds a JSON text, read without the package onnx.

A serialised model is a sequence of fields, and sequences may be joined (Protocol Buffers encoding). So the card is a
field appended to the model, which leaves the bytes of the model as they were and lets a digest in the card cover them.
"""

from __future__ import annotations

from typing import Final

from common.errors import CheckpointError

SUFFIX: Final = ".onnx"
KEY: Final = "hdplanner_card"
MAX_CARD: Final = 1 << 20
MAX_FIELDS: Final = 10_000
"""Fields of a model and of its metadata; real ones have a few dozen."""
# ModelProto.metadata_props is field 14, its entries have a key (1) and a value (2); all are length-delimited (type 2).
_METADATA: Final = 14 << 3 | 2
_ENTRY_KEY: Final = 1 << 3 | 2
_ENTRY_VALUE: Final = 2 << 3 | 2


def with_card(model: bytes, card: str) -> bytes:
    """Return a model that carries a card in its metadata; the model must carry none yet."""
    entry = _field(_ENTRY_KEY, KEY.encode()) + _field(_ENTRY_VALUE, card.encode())
    return model + _field(_METADATA, entry)


def split(data: bytes) -> tuple[bytes, str]:
    """Return the model without its card, and the card.

    Raises:
        CheckpointError: these are no bytes of a model, or it carries no card of this software.
    """
    try:
        at = fields = 0
        while at < len(data):
            fields += 1
            if fields > MAX_FIELDS:
                raise ValueError("it has fields without end")
            begin = at
            tag, value, at = _next(data, at)
            if tag != _METADATA or value is None or len(value) > MAX_CARD:
                continue
            entry: dict[int, bytes] = {}
            inner = 0
            while inner < len(value):
                fields += 1
                if fields > MAX_FIELDS:
                    raise ValueError("it has fields without end")
                key, part, inner = _next(value, inner)
                entry[key] = part or b""
            if entry.get(_ENTRY_KEY) == KEY.encode():
                return data[:begin] + data[at:], entry.get(_ENTRY_VALUE, b"").decode()
    except (IndexError, ValueError) as error:
        raise CheckpointError(f"this is no ONNX model, or it is damaged ({error}): copy or export it again") from error
    raise CheckpointError(f"the ONNX model carries no {KEY!r}: export it with `hd-learner export --format onnx`")


def _field(tag: int, content: bytes) -> bytes:
    return _varint(tag) + _varint(len(content)) + content


def _varint(number: int) -> bytes:
    out = bytearray()
    while number > 0x7F:
        out.append(number & 0x7F | 0x80)
        number >>= 7
    out.append(number)
    return bytes(out)


def _read_varint(data: bytes, at: int) -> tuple[int, int]:
    number = shift = 0
    while True:
        number |= (data[at] & 0x7F) << shift
        shift += 7
        at += 1
        if data[at - 1] < 0x80:
            return number, at
        if shift > 63:
            raise ValueError("a number is too long")


def _next(data: bytes, at: int) -> tuple[int, bytes | None, int]:
    """Return the tag of the field at a place, its content where it has a length, and the place behind it."""
    tag, at = _read_varint(data, at)
    kind = tag & 7
    if kind == 2:
        length, at = _read_varint(data, at)
        if at + length > len(data):
            raise ValueError("it is cut off")
        return tag, data[at : at + length], at + length
    if kind == 0:
        return tag, None, _read_varint(data, at)[1]
    if kind in (1, 5):
        return tag, None, at + (8 if kind == 1 else 4)
    raise ValueError(f"field type {kind} is unknown")
