"""JSON and TOML from anywhere, with bounds on size, nesting and numbers: no file costs more than a moment."""

from __future__ import annotations

import json
import math
import tomllib
from pathlib import Path
from typing import Any, Final, NoReturn

from common.system.stand_ins import stand_in
from common.system.text_files import decode_text

MAX_BYTES: Final = 1 << 20
"""Longest file of settings, of a card or of access rules; real ones have a few kilobytes."""
MAX_TOML_BYTES: Final = 1 << 17
"""The parser of TOML takes time with the square of the length of hostile keys."""
MAX_DEPTH: Final = 32


class DocumentError(ValueError):
    """A document is too large, nested too deeply or malformed; the text fits behind the name of the document."""


def read_text(path: Path, most: int = MAX_BYTES) -> str:
    """Return the text of a file of at most ``most`` bytes.

    Raises:
        DocumentError: it is larger, or no text (see `decode_text`).
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise DocumentError(f"must have at most {most:,} bytes, and has more")
    if instead := stand_in(data):
        raise DocumentError(instead)
    try:
        return decode_text(data)
    except ValueError as error:
        raise DocumentError(f"cannot be read: {error}") from None


def parse_json(text: str | bytes) -> Any:
    """Return the value of JSON whose numbers are finite and keys are there once, nested at most `MAX_DEPTH` levels.

    Raises:
        DocumentError: it is not that.
    """
    try:
        value = json.loads(text, parse_constant=_no_constant, parse_float=_finite, object_pairs_hook=_once)
    except RecursionError:
        raise DocumentError(_too_deep()) from None
    except ValueError as error:
        raise DocumentError(f"must be JSON: {error}") from None
    _check_depth(value)
    return value


def read_json(path: Path, most: int = MAX_BYTES) -> Any:
    """Return the value of a JSON file; errors as of `read_text` and `parse_json`."""
    return parse_json(read_text(path, most))


def parse_toml(text: str) -> dict[str, Any]:
    """Return the tables of TOML of at most `MAX_TOML_BYTES` that nests at most `MAX_DEPTH` levels.

    Raises:
        DocumentError: it is not that.
    """
    if len(text) > MAX_TOML_BYTES:
        raise DocumentError(f"must have at most {MAX_TOML_BYTES:,} characters of TOML, and has {len(text):,}")
    for line in text.splitlines():
        # The nesting of a dotted key costs the parser time before it could be seen in the result.
        if line.count(".") > MAX_DEPTH and line.partition("=")[0].count(".") > MAX_DEPTH:
            raise DocumentError(_too_deep())
    try:
        values = tomllib.loads(text)
    except RecursionError:
        raise DocumentError(_too_deep()) from None
    except ValueError as error:
        raise DocumentError(f"must be TOML: {error}") from None
    _check_depth(values)
    return values


def _check_depth(value: Any) -> None:
    level = [value]
    for _ in range(MAX_DEPTH + 1):
        inner: list[Any] = []
        for each in level:
            if isinstance(each, dict):
                inner += each.values()
            elif isinstance(each, list):
                inner += each
        if not inner:
            return
        level = inner
    raise DocumentError(_too_deep())


def _too_deep() -> str:
    return f"must not nest deeper than {MAX_DEPTH} levels"


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        seen: set[str] = set()
        # The reader of the standard library would take the last without a word.
        for key, _ in pairs:
            if key in seen:
                raise ValueError(f"the key {key[:60]!r} is there twice: leave one out")
            seen.add(key)
    return found


def _no_constant(text: str) -> NoReturn:
    raise ValueError(f"{text} is not JSON")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:20]} is too large a number")
    return value
