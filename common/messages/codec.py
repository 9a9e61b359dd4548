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
    reader = _Reader(data)
    value = reader.value(name, 0)
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
# Tags followed by a length: what they hold, and the bytes of the length.
_LENGTHS = {
    0xC4: ("bytes", 1),
    0xC5: ("bytes", 2),
    0xC6: ("bytes", 4),
    0xC7: ("extension", 1),
    0xC8: ("extension", 2),
    0xC9: ("extension", 4),
    0xD9: ("text", 1),
    0xDA: ("text", 2),
    0xDB: ("text", 4),
    0xDE: ("map", 2),
    0xDF: ("map", 4),
}
_SHAPES = tuple(struct.Struct(f"<{dimensions}I") for dimensions in range(MAX_DIMENSIONS + 1))
_FIXED_EXTENSIONS = {0xD4: 1, 0xD5: 2, 0xD6: 4, 0xD7: 8, 0xD8: 16}


class _Reader:
    """One pass over a message, from the first byte to the last."""

    __slots__ = ("data", "items", "position")

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.position = 0
        self.items = 0

    def value(self, path: str, depth: int) -> Any:
        self.items += 1
        if self.items > MAX_ITEMS:
            raise MessageError(path, f"is beyond the {MAX_ITEMS} items that a message may have")
        tag = self.byte(path)
        if tag < 0x80:
            return tag
        if tag in _LENGTHS:
            what, width = _LENGTHS[tag]
            length = int.from_bytes(self.take(width, path), "big")
            if what == "extension":
                return self.extension(length, path)
            if what == "text":
                return self.text(length, path, MAX_TEXT)
            if what == "map":
                return self.map(length, path, depth)
            return self.take(length, path)
        if tag >= 0xE0:
            return tag - 0x100
        if tag < 0x90:
            return self.map(tag & 0x0F, path, depth)
        if 0xA0 <= tag < 0xC0:
            return self.text(tag & 0x1F, path, MAX_TEXT)
        if tag in _CONSTANTS:
            return _CONSTANTS[tag]
        number = _NUMBERS.get(tag)
        if number is not None:
            return number.unpack(self.take(number.size, path))[0]
        if tag in _FIXED_EXTENSIONS:
            return self.extension(_FIXED_EXTENSIONS[tag], path)
        raise MessageError(path, f"has tag 0x{tag:02x}, which is no part of the protocol")

    def byte(self, path: str) -> int:
        try:
            value = self.data[self.position]
        except IndexError:
            raise MessageError(path, "needs 1 bytes, but only 0 are left") from None
        self.position += 1
        return value

    def take(self, length: int, path: str) -> bytes:
        first = self.position
        if length > len(self.data) - first:
            raise MessageError(path, f"needs {length} bytes, but only {len(self.data) - first} are left")
        self.position = first + length
        return self.data[first : self.position]

    def text(self, length: int, path: str, most: int) -> str:
        if length > most:
            raise MessageError(path, f"must have at most {most} bytes of text, got {length}")
        try:
            return self.take(length, path).decode("utf-8")
        except UnicodeDecodeError as error:
            raise MessageError(path, f"must be UTF-8: {error.reason}") from None

    def map(self, length: int, path: str, depth: int) -> dict[str, Any]:
        if depth >= MAX_DEPTH:
            raise MessageError(path, f"must not be nested deeper than {MAX_DEPTH} maps")
        if length > MAX_MAP:
            raise MessageError(path, f"must have at most {MAX_MAP} entries, got {length}")
        values: dict[str, Any] = {}
        for _ in range(length):
            name = self.name(path)
            inner = f"{path}.{name}"
            if name in values:
                raise MessageError(inner, "is duplicated")
            values[name] = self.value(inner, depth + 1)
        return values

    def name(self, path: str) -> str:
        tag = self.byte(path)
        if 0xA0 <= tag < 0xC0:
            return self.text(tag & 0x1F, path, MAX_NAME)
        what, width = _LENGTHS.get(tag, ("", 0))
        if what != "text":
            raise MessageError(path, f"must have text as names, got tag 0x{tag:02x}")
        return self.text(int.from_bytes(self.take(width, path), "big"), path, MAX_NAME)

    def extension(self, length: int, path: str) -> NDArray[Any]:
        kind = self.byte(path)
        if kind != ARRAY_EXTENSION:
            raise MessageError(path, f"must be an array (extension {ARRAY_EXTENSION}), got extension {kind}")
        if length < 2:
            raise MessageError(path, f"needs at least 2 bytes of array header, got {length}")
        first = self.position
        payload_end = first + length
        if payload_end > len(self.data):
            raise MessageError(path, f"needs {length} bytes, but only {len(self.data) - first} are left")
        code, dimensions = self.data[first], self.data[first + 1]
        if code >= len(DTYPES):
            raise MessageError(path, f"has the unknown dtype code {code}; codes are 0 to {len(DTYPES) - 1}")
        if dimensions > MAX_DIMENSIONS:
            raise MessageError(path, f"must have at most {MAX_DIMENSIONS} dimensions, got {dimensions}")
        start = first + 2 + 4 * dimensions
        if start > payload_end:
            raise MessageError(path, f"ends within its {dimensions} dimensions")
        shape = _SHAPES[dimensions].unpack_from(self.data, first + 2)
        dtype = DTYPES[code]
        size = math.prod(shape)
        if size * dtype.itemsize != payload_end - start:
            raise MessageError(
                path,
                f"of shape {shape} and dtype {dtype.name} needs {size * dtype.itemsize} bytes, "
                f"got {payload_end - start}",
            )
        self.position = payload_end
        if size == 0 and any(dimension > MAX_TEXT for dimension in shape):
            raise MessageError(path, f"has no elements, yet the shape {shape}")
        if code == 0 and size:
            highest = np.maximum.reduce(np.frombuffer(self.data, np.uint8, size, start))
            if highest > 1:
                raise MessageError(path, f"must hold booleans as 0 or 1, got {highest}")
        # A copy: aligned, writable, of native byte order, and it does not keep the whole message alive.
        return np.ndarray(shape, dtype, self.data, start).astype(_NATIVE[code])
