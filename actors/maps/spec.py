"""Specifications of map files: where they are, and what else is to be said about them.

::

    [PRESET:]PATH[?key=value&key=value][#train|#validation]

``PATH`` is a folder or a file. Keys are ``start`` and ``target`` (``X,Y`` in metres, map frame; for a file) and
``metres_per_pixel``. A path that exists as it is written is that path, whatever signs are in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from actors.maps.placing import MAX_COORDINATE, Position
from actors.maps.recommended import preset_names
from common.errors import MapError
from common.extensions import GENERATOR_PREFIX
from common.system.paths import exists, expanded

SPLITS = ("train", "validation")
_KEYS = ("start", "target", "metres_per_pixel")


@dataclass(frozen=True, slots=True)
class MapSpec:
    """A specification, taken apart.

    Attributes:
        text: as it was written.
        preset: name of a shipped set of settings; empty for none.
        path: folder or file.
        split: `train`, `validation` or empty.
        start: (x, y), metres, map frame; None when not given.
        target: likewise.
        metres_per_pixel: scale; None when not given.
    """

    text: str
    preset: str
    path: Path
    split: str = ""
    start: Position | None = None
    target: Position | None = None
    metres_per_pixel: float | None = None


def parse_spec(text: str) -> MapSpec:
    """Take the specification of a folder or a file apart.

    Raises:
        MapError: an unknown preset, split or key, or a value that is none.
    """
    preset, rest = _split_preset(text)
    if _exists(rest):
        return MapSpec(text, preset, expanded(rest))
    before, mark, split = rest.rpartition("#")
    if mark and "/" not in split:
        if split not in SPLITS:
            raise MapError(
                f"{text}: unknown split '{split}': choose #train or #validation, or leave it out for all maps"
            )
        rest = before
    else:
        split = ""
    path, _, query = rest.rpartition("?") if _exists(rest.rpartition("?")[0]) else rest.partition("?")
    if _exists(rest):
        path, query = rest, ""
    if not path:
        raise MapError(f"{text or 'an empty source'}: expected a folder or a map file, got none: name one")
    values = parameters(text, query)
    unknown = [key for key in values if key not in _KEYS]
    if unknown:
        raise MapError(f"{text}: unknown parameter '{unknown[0]}': choose from {', '.join(_KEYS)}")
    scale = None if "metres_per_pixel" not in values else _numbers(text, values, "metres_per_pixel", 1)[0]
    if scale is not None and scale <= 0.0:
        raise MapError(f"{text}: expected metres_per_pixel above 0, got {scale:g}: correct it")
    start, target = (
        None if key not in values else _position(_numbers(text, values, key, 2)) for key in ("start", "target")
    )
    return MapSpec(text, preset, expanded(path), split, start, target, scale)


def parameters(spec: str, query: str) -> dict[str, str]:
    """Return the parameters of a specification by name.

    Raises:
        MapError: something is no ``key=value``, or is given twice.
    """
    found: dict[str, str] = {}
    for pair in query.split("&") if query else []:
        key, equals, value = pair.partition("=")
        if not (key and equals and value):
            raise MapError(
                f"{spec}: expected key=value after '?', got '{pair}': write for example ?width=320&height=240"
            )
        if key in found:
            raise MapError(f"{spec}: parameter '{key}' is given twice: give it once")
        found[key] = value
    return found


def with_places(specs: list[str], start: Position | None, target: Position | None) -> list[str]:
    """Return sources of worlds with a start and a target of the command line put into the only one.

    Raises:
        MapError: there are several sources, the only one is no file, or it says its own start or target.
    """
    given = {"start": start, "target": target}
    given = {key: position for key, position in given.items() if position is not None}
    if not given:
        return specs
    options = " and ".join(f"--{key}" for key in given)
    if len(specs) != 1 or specs[0].startswith(GENERATOR_PREFIX):
        raise MapError(
            f"{options} expect one map file, got {', '.join(specs)}: name one file, or write file?start=X,Y for each"
        )
    spec = parse_spec(specs[0])
    if exists(spec.path) and spec.path.is_dir():
        raise MapError(f"{options} expect one map file, got the folder {spec.path}: name one of its files")
    for key in given:
        if getattr(spec, key) is not None:
            raise MapError(f"{specs[0]} specifies {key} itself: leave out one of the two, --{key} or this")
    text = specs[0]
    joint = "&" if "?" in text and not _exists(_split_preset(text)[1]) else "?"
    return [text + joint + place_text(start, target)]


def place_text(start: Position | None, target: Position | None) -> str:
    """Return start and target as a specification has them, such as ``start=1.5,2``."""
    places = (("start", start), ("target", target))
    return "&".join(f"{key}={place[0]!r},{place[1]!r}" for key, place in places if place is not None)


def _split_preset(text: str) -> tuple[str, str]:
    name, colon, rest = text.partition(":")
    if not colon or "/" in name or "." in name or _exists(text):
        return "", text
    known = preset_names()
    if name not in known:
        raise MapError(
            f"{text}: unknown set of settings '{name}': choose one of {', '.join(known)}, or write generator:NAME for "
            "generated worlds"
        )
    return name, rest


def _exists(text: str) -> bool:
    return bool(text) and exists(expanded(text))


def _numbers(spec: str, values: dict[str, str], key: str, count: int) -> list[float]:
    try:
        numbers = [float(part) for part in values[key].split(",")]
    except ValueError:
        numbers = []
    # Written so that NaN is not within.
    if len(numbers) != count or not all(abs(number) <= MAX_COORDINATE for number in numbers):
        wanted = "X,Y in metres" if count == 2 else "a number"
        raise MapError(f"{spec}: expected {key}={wanted}, got '{values[key]}': correct it")
    return numbers


def _position(numbers: list[float]) -> Position:
    return numbers[0], numbers[1]
