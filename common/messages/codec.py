"""The bytes of a message: a strict subset of msgpack, with arrays as one typed extension.

A message is a map from names to nil, booleans, integers, floats, text, bytes, arrays and further maps. Msgpack's own
arrays are no part of it. Writing uses the msgpack library. Reading does not: a peer may be hostile, and the reader
here bounds depth, lengths and the total number of items *before* it allocates anything, refuses what the protocol
does not know (duplicate names, foreign extensions, trailing bytes) and names the field at fault.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from common.errors import MessageError

ARRAY_EXTENSION = 1
"""Type number of the msgpack extension that holds an array."""

# Position in this list is the dtype's code on the wire: append only.
DTYPES: tuple[np.dtype[Any], ...] = tuple(
    np.dtype(name).newbyteorder("<")
    for name in (
        "bool",
        "int8",
        "int16",
        "int32",
        "int64",
        "uint8",
        "uint16",
        "uint32",
        "uint64",
        "float16",
        "float32",
        "float64",
    )
)
_NATIVE = tuple(dtype.newbyteorder("=") for dtype in DTYPES)
_CODES = {dtype: code for code, dtype in enumerate(DTYPES)}

MAX_DEPTH = 6
MAX_ITEMS = 8_192
MAX_MAP = 4_096
MAX_NAME = 256
MAX_TEXT = 1 << 20
MAX_DIMENSIONS = 3


def pack(fields: Mapping[str, Any]) -> bytes:
    """Return the bytes of a message.

    Args:
        fields: names to None, bool, int, float, str, bytes, numpy arrays or further mappings.

    Raises:
        TypeError: for a value that no message can hold.
    """
    return msgpack.packb(fields, default=_extension, use_bin_type=True)


def pack_array(array: NDArray[Any]) -> bytes:
    """Return the payload of the array extension: dtype code, number of dimensions, dimensions, raw elements.

    Dimensions are uint32; everything is little-endian, elements in C order.
    """
    code = _CODES.get(array.dtype.newbyteorder("<"))
    if code is None or array.ndim > MAX_DIMENSIONS:
        raise TypeError(
            f"no message can hold an array of {array.dtype} with {array.ndim} dimensions: use at most "
            f"{MAX_DIMENSIONS} and one of {', '.join(dtype.name for dtype in DTYPES)}"
        )
    header = struct.pack(f"<BB{array.ndim}I", code, array.ndim, *array.shape)
    return header + array.astype(DTYPES[code], copy=False).tobytes()


def unpack(data: bytes, name: str = "message", max_bytes: int = 1 << 20) -> dict[str, Any]:
    """Read the bytes of a message that may come from anywhere.

    Args:
        data: the whole message, nothing behind it.
        name: what the paths in errors start with.
        max_bytes: longest message accepted.

    Returns:
        Names to None, bool, int, float, str, bytes, arrays (which own their memory) or further dictionaries.

    Raises:
        MessageError: for anything that is not exactly one message.
    """
    if len(data) > max_bytes:
        raise MessageError(name, f"must have at most {max_bytes} bytes, got {len(data)}")
    reader = _Reader(data, name)
    value = reader.value(0)
    if not isinstance(value, dict):
        raise MessageError(name, f"must be a map, got {type(value).__name__}")
    if reader.position != len(data):
        raise MessageError(name, f"must end after {reader.position} bytes, got {len(data)}")
    return value


def _extension(value: object) -> msgpack.ExtType:
    if isinstance(value, np.ndarray):
        return msgpack.ExtType(ARRAY_EXTENSION, pack_array(value))
    raise TypeError(f"no message can hold a {type(value).__name__}")


# Tags whose value has a fixed binary form, and the struct that reads it.
_NUMBERS = {
    tag: struct.Struct(form)
    for tag, form in {
        0xCA: ">f",
        0xCB: ">d",
        0xCC: ">B",
        0xCD: ">H",
        0xCE: ">I",
        0xCF: ">Q",
        0xD0: ">b",
        0xD1: ">h",
        0xD2: ">i",
        0xD3: ">q",
    }.items()
}
_CONSTANTS = {0xC0: None, 0xC2: False, 0xC3: True}
# Tags followed by a length: the bytes of that.
_EXTENSIONS = {0xC7: 1, 0xC8: 2, 0xC9: 4}
_BYTES = {0xC4: 1, 0xC5: 2, 0xC6: 4}
_TEXTS = {0xD9: 1, 0xDA: 2, 0xDB: 4}
_MAPS = {0xDE: 2, 0xDF: 4}
_FIXED_EXTENSIONS = {0xD4: 1, 0xD5: 2, 0xD6: 4, 0xD7: 8, 0xD8: 16}
_SHAPES = tuple(struct.Struct(f"<{dimensions}I") for dimensions in range(MAX_DIMENSIONS + 1))


class _Reader:
    """One pass over a message, from the first byte to the last.

    Most of a delivery are arrays with short names, so those come first, and nothing is put together for the text of an
    error before there is one.
    """

    __slots__ = ("data", "items", "names", "position")

    def __init__(self, data: bytes, name: str) -> None:
        self.data = data
        self.position = 0
        self.items = 1
        self.names = [name]
        """Of the maps around the value that is being read, and its own."""

    def error(self, problem: str) -> MessageError:
        return MessageError(".".join(self.names), problem)

    def value(self, depth: int) -> Any:
        tag = self.byte()
        if tag in _EXTENSIONS:
            return self.array(self.number(_EXTENSIONS[tag]))
        if tag < 0x80:
            return tag
        if tag < 0x90:
            return self.map(tag & 0x0F, depth)
        if 0xA0 <= tag < 0xC0:
            return self.text(tag & 0x1F, MAX_TEXT)
        if tag >= 0xE0:
            return tag - 0x100
        if tag in _CONSTANTS:
            return _CONSTANTS[tag]
        if tag in _NUMBERS:
            number = _NUMBERS[tag]
            return number.unpack(self.take(number.size))[0]
        if tag in _FIXED_EXTENSIONS:
            return self.array(_FIXED_EXTENSIONS[tag])
        if tag in _TEXTS:
            return self.text(self.number(_TEXTS[tag]), MAX_TEXT)
        if tag in _BYTES:
            return self.take(self.number(_BYTES[tag]))
        if tag in _MAPS:
            return self.map(self.number(_MAPS[tag]), depth)
        raise self.error(f"has tag 0x{tag:02x}, which is no part of the protocol")

    def byte(self) -> int:
        try:
            value = self.data[self.position]
        except IndexError:
            raise self.error("needs 1 bytes, but only 0 are left") from None
        self.position += 1
        return value

    def take(self, length: int) -> bytes:
        first = self.position
        last = first + length
        if last > len(self.data):
            raise self.error(f"needs {length} bytes, but only {len(self.data) - first} are left")
        self.position = last
        return self.data[first:last]

    def number(self, width: int) -> int:
        return int.from_bytes(self.take(width), "big")

    def text(self, length: int, most: int) -> str:
        if length > most:
            raise self.error(f"must have at most {most} bytes of text, got {length}")
        try:
            return str(self.take(length), "utf-8")
        except UnicodeDecodeError as error:
            raise self.error(f"must be UTF-8: {error.reason}") from None

    def map(self, length: int, depth: int) -> dict[str, Any]:
        if depth >= MAX_DEPTH:
            raise self.error(f"must not be nested deeper than {MAX_DEPTH} maps")
        if length > MAX_MAP:
            raise self.error(f"must have at most {MAX_MAP} entries, got {length}")
        self.items += length
        if self.items > MAX_ITEMS:
            raise self.error(f"is beyond the {MAX_ITEMS} items that a message may have")
        values: dict[str, Any] = {}
        names = self.names
        for _ in range(length):
            name = self.name()
            names.append(name)
            if name in values:
                raise self.error("is duplicated")
            values[name] = self.value(depth + 1)
            names.pop()
        return values

    def name(self) -> str:
        tag = self.byte()
        if 0xA0 <= tag < 0xC0:
            return self.text(tag & 0x1F, MAX_NAME)
        if tag not in _TEXTS:
            raise self.error(f"must have text as names, got tag 0x{tag:02x}")
        return self.text(self.number(_TEXTS[tag]), MAX_NAME)

    def array(self, length: int) -> NDArray[Any]:
        data = self.data
        kind = self.byte()
        if kind != ARRAY_EXTENSION:
            raise self.error(f"must be an array (extension {ARRAY_EXTENSION}), got extension {kind}")
        if length < 2:
            raise self.error(f"needs at least 2 bytes of array header, got {length}")
        first = self.position
        last = first + length
        if last > len(data):
            raise self.error(f"needs {length} bytes, but only {len(data) - first} are left")
        code, dimensions = data[first], data[first + 1]
        if code >= len(DTYPES):
            raise self.error(f"has the unknown dtype code {code}; codes are 0 to {len(DTYPES) - 1}")
        if dimensions > MAX_DIMENSIONS:
            raise self.error(f"must have at most {MAX_DIMENSIONS} dimensions, got {dimensions}")
        start = first + 2 + 4 * dimensions
        if start > last:
            raise self.error(f"ends within its {dimensions} dimensions")
        shape = _SHAPES[dimensions].unpack_from(data, first + 2)
        dtype = DTYPES[code]
        size = math.prod(shape)
        if size * dtype.itemsize != last - start:
            needed = size * dtype.itemsize
            raise self.error(f"of shape {shape} and dtype {dtype.name} needs {needed} bytes, got {last - start}")
        self.position = last
        if size == 0:
            if any(dimension > MAX_TEXT for dimension in shape):
                raise self.error(f"has no elements, yet the shape {shape}")
            return np.empty(shape, _NATIVE[code])
        if code == 0 and (others := data[start:last].translate(None, b"\0\1")):
            raise self.error(f"must hold booleans as 0 or 1, got {max(others)}")
        # A copy: aligned, writable, of native byte order, and it does not keep the whole message alive.
        array = np.frombuffer(data, dtype, size, start).astype(_NATIVE[code])
        return array if dimensions == 1 else array.reshape(shape)
