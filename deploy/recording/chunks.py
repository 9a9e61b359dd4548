"""Compressed chunks of MCAP files, unpacked within bounds: a few kilobytes may claim to be gigabytes."""

from __future__ import annotations

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


def records_in(chunk: Chunk, path: Path) -> list[Any]:
    """Return the records of a chunk after checking its sum.

    Args:
        chunk: of the file.
        path: of the file, for messages.

    Raises:
        RecordingError: it is larger than `MAX_CHUNK`, or packed in a way that nobody here knows.
    """
    if chunk.uncompressed_size > MAX_CHUNK:
        raise _too_large(path, f"{chunk.uncompressed_size:,}")
    most = chunk.uncompressed_size + 1
    if chunk.compression == "zstd":
        data = zstandard.ZstdDecompressor(max_window_size=MAX_CHUNK).stream_reader(chunk.data).read(most)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=most)
    elif chunk.compression == "":
        data = chunk.data
    else:
        raise RecordingError(f"{path}: chunks packed with {chunk.compression[:20]!r} cannot be read: use zstd or lz4")
    if len(data) > chunk.uncompressed_size:
        raise _too_large(path, "more than it says")
    return breakup_chunk(replace(chunk, compression="", data=data), validate_crc=True)


def _too_large(path: Path, got: str) -> RecordingError:
    return RecordingError(f"{path}: expected chunks of at most {MAX_CHUNK:,} bytes, got one of {got}")
