"""Compressed chunks of MCAP files, unpacked within bounds: a few kilobytes may claim to be gigabytes."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import lz4.frame
import zstandard
from mcap.records import Chunk
from mcap.stream_reader import breakup_chunk

from deploy.recording.errors import RecordingError

MAX_CHUNK: Final = 1 << 26
"""Bytes of a chunk, packed or not: ROS 2 and Foxglove write chunks of at most a few megabytes, or of one message."""

# Times, size, sum and the length of the packing's name; a length; opcode and length of a record.
_FIXED: Final = struct.Struct("<QQQII")
_LENGTH: Final = struct.Struct("<Q")
_RECORD: Final = struct.Struct("<BQ")


def records_in(chunk: Chunk, path: Path) -> list[Any]:
    """Return the records of a chunk after checking its sum.

    Args:
        chunk: of the file.
        path: of the file, for messages.

    Raises:
        RecordingError: it is larger than `MAX_CHUNK`, or packed in a way that nobody here knows.
    """
    data = _unpacked(chunk, path)
    if len(data) > chunk.uncompressed_size:
        raise _too_large(path, "more than it says")
    return breakup_chunk(replace(chunk, compression="", data=data), validate_crc=True)


def records_before_cut(content: bytes, path: Path) -> list[Any]:
    """Return the whole records of a chunk whose end is missing; its sum cannot be checked.

    Args:
        content: what the file holds of the chunk, without opcode and length.
        path: of the file, for messages.

    Raises:
        RecordingError: as `records_in`.
    """
    if len(content) < _FIXED.size:
        return []
    start, end, size, crc, name_length = _FIXED.unpack_from(content)
    # After the name of the packing comes the length of the data, which is longer than what is left.
    at = _FIXED.size + name_length
    if at + _LENGTH.size > len(content):
        return []
    name = content[_FIXED.size : at].decode("utf-8", "replace")
    data = _unpacked(Chunk(name, content[at + _LENGTH.size :], end, start, crc, size), path)
    whole = 0
    while whole + _RECORD.size <= len(data):
        following = whole + _RECORD.size + _RECORD.unpack_from(data, whole)[1]
        if following > len(data):
            break
        whole = following
    return breakup_chunk(Chunk("", data[:whole], end, start, 0, whole))


def _unpacked(chunk: Chunk, path: Path) -> bytes:
    """Return the data of a chunk, at most one byte more than it claims; what there is of data that ends too early."""
    if chunk.uncompressed_size > MAX_CHUNK:
        raise _too_large(path, f"{chunk.uncompressed_size:,}")
    most = chunk.uncompressed_size + 1
    if chunk.compression == "zstd":
        return bytes(zstandard.ZstdDecompressor(max_window_size=MAX_CHUNK).stream_reader(chunk.data).read(most))
    if chunk.compression == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=most))
    if chunk.compression == "":
        return bytes(chunk.data)
    raise RecordingError(f"{path}: chunks packed with {chunk.compression[:20]!r} cannot be read: use zstd or lz4")


def _too_large(path: Path, got: str) -> RecordingError:
    return RecordingError(f"{path}: expected chunks of at most {MAX_CHUNK:,} bytes, got one of {got}")
