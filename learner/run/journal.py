"""The journal of a run: every accepted message, on disk before it is acknowledged.

It covers the death of the process at any moment: what was acknowledged is in the page cache of the system or on the
disk, and a resumed learner reads it again. Nothing is synced per message, so a power failure may cost what came after
the last checkpoint. The journal is also the snapshot of the replay buffer: its segments stay as long as the buffer
holds something of them, so a checkpoint writes no experience a second time.

A segment is a file of records: length and checksum of what follows (uint32 each, little-endian), kind (uint8), payload.
"""

from __future__ import annotations

import logging
import os
import struct
import zlib
from collections.abc import Iterator
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

from common.closing import Closing
from common.errors import CheckpointError

logger = logging.getLogger(__name__)

_HEAD = struct.Struct("<II")
_SUFFIX = ".log"
SEGMENT_BYTES = 64 << 20
MAX_RECORD = 256 << 20


class RecordKind(IntEnum):
    """What a record holds."""

    DELIVERY = 1
    """A delivery of an actor, as it travels on the bus."""
    VERSION = 2
    """Number of a policy version that is about to be published, uint64."""


class Record(NamedTuple):
    """One record of the journal."""

    segment: int
    kind: RecordKind
    payload: bytes


class Journal(Closing):
    """Append-only segments in a folder; one process at a time (the run folder's lock sees to that).

    Opening cuts a torn last record off: its writer died before it could acknowledge it.

    Usage::

        with Journal(folder) as journal:
            journal.append(RecordKind.DELIVERY, payload)
            position = journal.rotate()      # a checkpoint covers everything before this segment
            journal.sync()

    Args:
        folder: made when missing.
        segment_bytes: a new segment begins beyond this size.
    """

    def __init__(self, folder: Path, segment_bytes: int = SEGMENT_BYTES) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._segment_bytes = segment_bytes
        self._unsynced: list[Path] = []
        existing = self.segments()
        if existing:
            self._cut_torn_end(self._path(existing[-1]))
        self._segment = existing[-1] + 1 if existing else 1
        self._descriptor = self._open()
        self._size = 0

    @property
    def segment(self) -> int:
        """Number of the segment that is being written."""
        return self._segment

    @property
    def size(self) -> int:
        """Size of all segments on disk, bytes."""
        return sum(self._path(number).stat().st_size for number in self.segments())

    def segments(self) -> list[int]:
        """Numbers of all segments, ascending."""
        found = [int(path.stem) for path in self._folder.glob(f"*{_SUFFIX}") if path.stem.isdigit()]
        return sorted(found)

    def append(self, kind: RecordKind, payload: bytes) -> None:
        """Write one record; it survives the death of this process once this returns.

        Raises:
            CheckpointError: when the disk refuses it; the journal then is as it was before.
        """
        body = bytes([kind]) + payload
        record = _HEAD.pack(len(body), zlib.crc32(body)) + body
        try:
            written = os.write(self._descriptor, record)
            while written < len(record):
                written += os.write(self._descriptor, record[written:])
        except OSError as error:
            os.ftruncate(self._descriptor, self._size)
            raise CheckpointError(
                f"cannot write to the journal {self._path(self._segment)}: {error.strerror}; make room on the disk"
            ) from error
        self._size += len(record)
        if self._size >= self._segment_bytes:
            self.rotate()

    def rotate(self) -> int:
        """Begin a new segment and return its number; everything written so far lies before it."""
        if self._size:
            os.close(self._descriptor)
            self._unsynced.append(self._path(self._segment))
            self._segment += 1
            self._descriptor = self._open()
            self._size = 0
        return self._segment

    def sync(self) -> None:
        """Bring all finished segments onto the disk."""
        while self._unsynced:
            path = self._unsynced[0]
            if path.exists():
                with path.open("rb") as file:
                    os.fsync(file.fileno())
            self._unsynced.pop(0)

    def drop_before(self, segment: int) -> None:
        """Delete the segments with a lower number."""
        for number in self.segments():
            if number < min(segment, self._segment):
                self._path(number).unlink()

    def read(self, first: int = 0) -> Iterator[Record]:
        """Yield the records of all finished segments from number ``first`` on, in the order of writing.

        Raises:
            CheckpointError: when a segment is damaged.
        """
        for number in self.segments():
            if first <= number < self._segment:
                yield from self.read_segment(number)

    def read_segment(self, number: int) -> Iterator[Record]:
        """Yield the records of one finished segment.

        Raises:
            CheckpointError: where the segment is damaged.
        """
        path = self._path(number)
        sound = 0
        for end, body in _records(path):
            sound = end
            try:
                yield Record(number, RecordKind(body[0]), body[1:])
            except ValueError:
                raise CheckpointError(
                    f"{path}: a record is of the unknown kind {body[0]}: resume with the software that wrote it"
                ) from None
        if sound != path.stat().st_size:
            raise CheckpointError(
                f"{path} is damaged at byte {sound}: restore the file, or delete it to go on without what it holds"
            )

    def close(self) -> None:
        """Sync and close; safe to call twice."""
        if self._descriptor >= 0:
            self.rotate()
            os.close(self._descriptor)
            self._descriptor = -1
            self._path(self._segment).unlink(missing_ok=True)
            self.sync()

    def _open(self) -> int:
        return os.open(self._path(self._segment), os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)

    def _path(self, segment: int) -> Path:
        return self._folder / f"{segment:08d}{_SUFFIX}"

    def _cut_torn_end(self, path: Path) -> None:
        sound = max((end for end, _ in _records(path)), default=0)
        torn = path.stat().st_size - sound
        if torn:
            logger.warning("%s: cut %d bytes of a record that was never acknowledged", path, torn)
            os.truncate(path, sound)


def _records(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield (end position, kind and payload) of each whole record up to the first that is not."""
    position = 0
    with path.open("rb") as file:
        while len(head := file.read(_HEAD.size)) == _HEAD.size:
            length, checksum = _HEAD.unpack(head)
            body = file.read(length) if 0 < length <= MAX_RECORD else b""
            if len(body) != length or not body or zlib.crc32(body) != checksum:
                return
            position += _HEAD.size + length
            yield position, body
