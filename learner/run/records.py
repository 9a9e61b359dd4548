"""The form of a journal's records, and how they are found again behind damage.

A segment is a file of records, one behind the other. Each begins with the segment's marker: eight random bytes that are
part of the file's name, so no damage inside the file touches them and no payload from the network can contain them on
purpose. All numbers are little-endian:

======================  ======  ====================================================================
marker                  8 bytes the same in all records of a segment
number                  uint64  counts the records of the journal, from 0, over all segments
length                  uint32  of kind and payload
checksum of the body    uint32  CRC-32 of kind and payload
checksum of the head    uint32  CRC-32 of all before it
kind                    uint8   see `RecordKind`
payload
======================  ======  ====================================================================

Runs of format 3 have segments without a marker, whose records are length, checksum of the body, kind and payload: they
are read up to the first damage, since nothing tells where the next record begins.
"""

from __future__ import annotations

import mmap
import secrets
import struct
import zlib
from collections.abc import Iterator
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

SUFFIX = ".log"
MAX_RECORD = 256 << 20
MARKER_BYTES = 8
MAX_REMAINS = 20
"""Records of which something is told in one piece of damage."""

_HEAD = struct.Struct("<8sQIII")
_CHECKED = _HEAD.size - 4
_OLD_HEAD = struct.Struct("<II")


class RecordKind(IntEnum):
    """What a record holds."""

    DELIVERY = 1
    """A delivery of an actor, as it travels on the bus."""
    VERSION = 2
    """Number of a policy version that is about to be published, uint64."""


class Found(NamedTuple):
    """A sound record in a file.

    Attributes:
        start: its first byte.
        end: the byte behind its last.
        number: in the journal, -1 in segments of format 3.
        kind: see `RecordKind`; any other number is from another release.
        payload: its content.
    """

    start: int
    end: int
    number: int
    kind: int
    payload: bytes


class Damage(NamedTuple):
    """Bytes of a file that are no record.

    Attributes:
        start: first byte.
        end: byte behind the last: where the next sound record begins, or the end of the file.
        torn: the beginning of a record that ends with the file, which a writer that died has left behind.
        remains: (number, payload) of the first records in it whose head is sound; the payload is damaged or cut off.
    """

    start: int
    end: int
    torn: bool
    remains: tuple[tuple[int, bytes], ...] = ()


def segment_name(number: int, marker: bytes) -> str:
    """Name of the file of a segment."""
    return f"{number:08d}-{marker.hex()}{SUFFIX}"


def read_segment_name(name: str) -> tuple[int, bytes] | None:
    """Return number and marker of the segment in a file of this name; None when it is no segment's name.

    The marker is empty for a segment of format 3.
    """
    digits, dash, marker = name.removesuffix(SUFFIX).partition("-")
    if not name.endswith(SUFFIX) or not (digits.isascii() and digits.isdigit()):
        return None
    try:
        found = bytes.fromhex(marker)
    except ValueError:
        return None
    return (int(digits), found) if len(found) == (MARKER_BYTES if dash else 0) else None


def segment_paths(folder: Path) -> dict[int, Path]:
    """Return the file of each segment in a journal's folder, by its number."""
    named = ((path, read_segment_name(path.name)) for path in folder.glob(f"*{SUFFIX}"))
    return {name[0]: path for path, name in named if name is not None}


def new_marker() -> bytes:
    """Draw the marker of a new segment."""
    return secrets.token_bytes(MARKER_BYTES)


def encode_record(marker: bytes, number: int, kind: RecordKind, payload: bytes) -> bytes:
    """Return the bytes of a record."""
    body = bytes([kind]) + payload
    head = _HEAD.pack(marker, number, len(body), zlib.crc32(body), 0)[:_CHECKED]
    return head + struct.pack("<I", zlib.crc32(head)) + body


def scan(path: Path) -> Iterator[Found | Damage]:
    """Yield the records of a segment, and the damage between and behind them, in the order of the file."""
    named = read_segment_name(path.name)
    if named is None:
        raise ValueError(f"{path} is not named as a segment is")
    _, marker = named
    with path.open("rb") as file:
        if path.stat().st_size == 0:
            return
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            yield from _scan(content, marker) if marker else _scan_old(content)


def _scan(content: mmap.mmap, marker: bytes) -> Iterator[Found | Damage]:
    position = 0
    while position < len(content):
        record = _read(content, marker, position)
        if record is None:
            end = _next_sound(content, marker, position + 1)
            torn = end == len(content) and _is_torn(content, marker, position)
            yield Damage(position, end, torn, () if torn else _remains(content, marker, position, end))
            position = end
        else:
            yield record
            position = record.end


def _read(content: mmap.mmap, marker: bytes, position: int) -> Found | None:
    head = content[position : position + _HEAD.size]
    if len(head) < _HEAD.size or not head.startswith(marker):
        return None
    _, number, length, checksum, own = _HEAD.unpack(head)
    if zlib.crc32(head[:_CHECKED]) != own or not 0 < length <= MAX_RECORD:
        return None
    start = position + _HEAD.size
    body = content[start : start + length]
    if len(body) != length or zlib.crc32(body) != checksum:
        return None
    return Found(position, start + length, number, body[0], body[1:])


def _next_sound(content: mmap.mmap, marker: bytes, position: int) -> int:
    """Where the next sound record begins; the length of the content when there is none."""
    while (position := content.find(marker, position)) >= 0:
        if _read(content, marker, position) is not None:
            return position
        position += 1
    return len(content)


def _remains(content: mmap.mmap, marker: bytes, position: int, end: int) -> tuple[tuple[int, bytes], ...]:
    """What is left of the records in some damaged bytes."""
    found: list[tuple[int, bytes]] = []
    while len(found) < MAX_REMAINS and (position := content.find(marker, position, end)) >= 0:
        head = content[position : position + _HEAD.size]
        position += 1
        if len(head) == _HEAD.size:
            _, number, length, _, own = _HEAD.unpack(head)
            if zlib.crc32(head[:_CHECKED]) == own and 0 < length <= MAX_RECORD:
                start = position - 1 + _HEAD.size
                found.append((number, content[start + 1 : min(start + length, end)]))
    return tuple(found)


def _is_torn(content: mmap.mmap, marker: bytes, position: int) -> bool:
    """Whether the rest of the content is a sound beginning of a record that ends too early."""
    head = content[position : position + _HEAD.size]
    if len(head) < _HEAD.size:
        return head.startswith(marker) or marker.startswith(head)
    _, _, length, _, own = _HEAD.unpack(head)
    whole = position + _HEAD.size + length
    return head.startswith(marker) and zlib.crc32(head[:_CHECKED]) == own and whole > len(content)


def _scan_old(content: mmap.mmap) -> Iterator[Found | Damage]:
    position = 0
    while position < len(content):
        head = content[position : position + _OLD_HEAD.size]
        start = position + _OLD_HEAD.size
        length, checksum = _OLD_HEAD.unpack(head) if len(head) == _OLD_HEAD.size else (MAX_RECORD, 0)
        body = content[start : start + length] if 0 < length <= MAX_RECORD else b""
        if len(body) != length or zlib.crc32(body) != checksum:
            yield Damage(position, len(content), torn=False)
            return
        position = start + length
        yield Found(start - _OLD_HEAD.size, position, -1, body[0], body[1:])
