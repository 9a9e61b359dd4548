"""The messages of browsers, read with bounds; docs/page.md describes all of them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from common.errors import MessageError
from common.system.documents import DocumentError, parse_json

VERSION: Final = 1
"""Raised with every change that an older reader would misunderstand."""
MAX_MESSAGE: Final = 16 << 10
"""Longer messages of a browser end its connection, bytes."""
MAX_PATTERNS: Final = 64
MAX_NAME: Final = 128
"""Characters of a channel's name, or of a pattern."""


@dataclass(frozen=True, slots=True)
class Hello:
    """A browser introduces itself, and perhaps says that it may command.

    Attributes:
        token: empty for a reader.
    """

    token: str


@dataclass(frozen=True, slots=True)
class Watch:
    """What a browser wants to see from now on.

    Attributes:
        patterns: names of channels; one that ends in ``*`` stands for all that begin so.
    """

    patterns: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Ask:
    """A command.

    Attributes:
        number: by which the browser knows the answer.
        target: what is commanded.
        verb: what to do.
        arguments: a JSON object.
    """

    number: int
    target: str
    verb: str
    arguments: Mapping[str, Any]


def read_message(text: str) -> Hello | Watch | Ask:
    """Read a message of a browser.

    Raises:
        MessageError: it is none, of another version, or beyond its bounds.
    """
    if len(text) > MAX_MESSAGE:
        raise MessageError("message", f"must have at most {MAX_MESSAGE} characters, got {len(text)}")
    try:
        found = parse_json(text)
    except DocumentError as error:
        raise MessageError("message", f"must be a JSON object: {error}") from None
    if not isinstance(found, dict):
        raise MessageError("message", f"must be a JSON object, got {type(found).__name__}")
    kind = found.get("type")
    if kind == "hello":
        version = found.get("protocol")
        if version != VERSION:
            raise MessageError("hello.protocol", f"must be {VERSION}, got {_short(version)}: load the page anew")
        return Hello(_text(found, "hello", "token", ""))
    if kind == "watch":
        patterns = found.get("channels")
        if not isinstance(patterns, list) or len(patterns) > MAX_PATTERNS:
            raise MessageError("watch.channels", f"must be a list of at most {MAX_PATTERNS} names")
        if not all(isinstance(each, str) and 0 < len(each) <= MAX_NAME for each in patterns):
            raise MessageError("watch.channels", f"must be names of 1 to {MAX_NAME} characters")
        return Watch(tuple(patterns))
    if kind == "command":
        number, arguments = found.get("id"), found.get("arguments", {})
        if not isinstance(number, int) or isinstance(number, bool) or not 0 <= number < 1 << 53:
            raise MessageError("command.id", f"must be an integer from 0 to 2^53 - 1, got {_short(number)}")
        if not isinstance(arguments, dict):
            raise MessageError("command.arguments", f"must be a JSON object, got {type(arguments).__name__}")
        return Ask(number, _text(found, "command", "target", ""), _text(found, "command", "verb"), arguments)
    raise MessageError("type", f"must be hello, watch or command, got {_short(kind)}")


def to_text(value: Any) -> str:
    """Return JSON as every browser reads it.

    Raises:
        ValueError: it holds a number that is not finite.
        TypeError: it holds what JSON has no form for.
    """
    return json.dumps(value, separators=(",", ":"), allow_nan=False)


def _text(found: Mapping[str, Any], kind: str, name: str, default: str | None = None) -> str:
    value = found.get(name, default)
    if not isinstance(value, str) or len(value) > 2 * MAX_NAME:
        raise MessageError(
            f"{kind}.{name}", f"must be a text of at most {2 * MAX_NAME} characters, got {_short(value)}"
        )
    return value


def _short(value: Any) -> str:
    return repr(value)[:40]
