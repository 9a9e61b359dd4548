"""Reading the fields of a decoded message, each with its type and bounds, with errors that name the path."""

from __future__ import annotations

import math
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from common.errors import MessageError
from common.ids import ID_PATTERN
from common.system.documents import DocumentError, parse_json
from common.system.printable import is_printable, printable

MAX_SAFE_INTEGER = 2**53 - 1
"""Largest counter on the wire: every language's floating numbers hold it exactly."""
MAX_INCARNATION = 2**63 - 1
"""Largest number that a process draws for itself."""


class Fields:
    """The fields of one map of a message; each is read once, and none may be left over.

    Usage::

        fields = Fields(values, "ack")
        sequence = fields.integer("sequence", 0, 10)
        fields.finish()
    """

    def __init__(self, values: dict[str, Any], path: str) -> None:
        self._values = dict(values)
        self.path = path

    def finish(self) -> None:
        """Raise MessageError when a field is left that nobody asked for."""
        for name in self._values:
            raise MessageError(f"{self.path}.{name}", "is no field of this message")

    def has(self, name: str) -> bool:
        """Whether a field that may be left out is there."""
        return name in self._values

    def fail(self, name: str, problem: str) -> NoReturn:
        """Raise MessageError for a field."""
        raise MessageError(f"{self.path}.{name}", problem)

    def _take(self, name: str) -> Any:
        try:
            return self._values.pop(name)
        except KeyError:
            raise MessageError(f"{self.path}.{name}", "is missing") from None

    def integer(self, name: str, low: int = 0, high: int = MAX_SAFE_INTEGER) -> int:
        """Return an integer from ``low`` to ``high``, both included."""
        value = self._take(name)
        if type(value) is not int or not low <= value <= high:
            self.fail(name, f"must be an integer from {low} to {high}, got {_show(value)}")
        return value

    def number(self, name: str, low: float = -1e12, high: float = 1e12) -> float:
        """Return a finite number from ``low`` to ``high``, both included."""
        value = self._take(name)
        if type(value) not in (int, float) or not (math.isfinite(value) and low <= value <= high):
            self.fail(name, f"must be a finite number from {low} to {high}, got {_show(value)}")
        return float(value)

    def flag(self, name: str) -> bool:
        """Return a boolean."""
        value = self._take(name)
        if type(value) is not bool:
            self.fail(name, f"must be true or false, got {_show(value)}")
        return value

    def text(self, name: str, longest: int = 256) -> str:
        """Return one line of text of at most ``longest`` characters, all of them safe on a terminal."""
        value = self._text(name, longest)
        if not is_printable(value):
            self.fail(name, f"must be one line without control characters, got {_show(value)}")
        return value

    def prose(self, name: str, longest: int) -> str:
        """Return text of at most ``longest`` characters, made safe for a terminal."""
        return printable(self._text(name, longest))[:longest]

    def _text(self, name: str, longest: int) -> str:
        value = self._take(name)
        if type(value) is not str or len(value) > longest:
            self.fail(name, f"must be text of at most {longest} characters, got {_show(value)}")
        return value

    def word(self, name: str, *words: str) -> str:
        """Return text that is one of ``words``."""
        value = self.text(name)
        if value not in words:
            self.fail(name, f"must be one of {', '.join(words)}, got {_show(value)}")
        return value

    def identifier(self, name: str) -> str:
        """Return text that may be one part of a bus key."""
        value = self._take(name)
        if type(value) is not str or not ID_PATTERN.fullmatch(value):
            self.fail(name, f"must be 1 to 64 lower-case letters, digits and dashes, got {_show(value)}")
        return value

    def digest(self, name: str) -> str:
        """Return a SHA-256 digest: 64 lower-case hexadecimal digits."""
        value = self._take(name)
        if type(value) is not str or len(value) != 64 or set(value) - set("0123456789abcdef"):
            self.fail(name, f"must be a SHA-256 digest of 64 hexadecimal digits, got {_show(value)}")
        return value

    def document(self, name: str, longest: int = 1 << 18) -> dict[str, Any]:
        """Return a JSON object that travels as text; all its numbers are finite."""
        return self._parsed(name, self._text(name, longest))

    def json_text(self, name: str, longest: int) -> str:
        """Return the text of a JSON object, as it came."""
        text = self._text(name, longest)
        self._parsed(name, text)
        return text

    def _parsed(self, name: str, text: str) -> dict[str, Any]:
        try:
            value = parse_json(text)
        except DocumentError as error:
            self.fail(name, str(error))
        if not isinstance(value, dict):
            self.fail(name, f"must be a JSON object, got {_show(value)}")
        return value

    def array(self, name: str, dtype: type[np.generic], shape: tuple[int | None, ...]) -> NDArray[Any]:
        """Return an array of exactly this dtype and shape; None in the shape stands for any length."""
        value = self._take(name)
        if not isinstance(value, np.ndarray):
            self.fail(name, f"must be an array, {_show_array(dtype, shape)}, got {_show(value)}")
        fits = value.dtype.type is dtype and value.ndim == len(shape)
        for want, have in zip(shape, value.shape, strict=False):
            fits = fits and (want is None or want == have)
        if not fits:
            self.fail(name, f"must be {_show_array(dtype, shape)}, got {_show_array(value.dtype, value.shape)}")
        return value

    def fields(self, name: str) -> Fields:
        """Return a nested map."""
        value = self._take(name)
        if type(value) is not dict:
            self.fail(name, f"must be a map, got {_show(value)}")
        return Fields(value, f"{self.path}.{name}")

    def optional_fields(self, name: str) -> Fields | None:
        """Return a nested map, or None where nil was sent."""
        if name in self._values and self._values[name] is None:
            del self._values[name]
            return None
        return self.fields(name)

    def rest(self) -> dict[str, Any]:
        """Return all fields that are left."""
        values, self._values = self._values, {}
        return values


def _show(value: object) -> str:
    """Return a value short enough for a log line."""
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype.name}"
    if isinstance(value, dict):
        return "a map"
    text = printable(repr(value))
    return text if len(text) <= 60 else text[:60] + "..."


def _show_array(dtype: npt.DTypeLike, shape: tuple[int | None, ...]) -> str:
    inner = ", ".join("any" if length is None else str(length) for length in shape)
    return f"{np.dtype(dtype).name} of shape " + (f"({inner},)" if len(shape) == 1 else f"({inner})")
