"""TensorBoard's event files: records of protocol buffers, and the way back to them behind damage.

A record is its length (uint64), the checksum of that, the event, and the checksum of the event (masked CRC-32C).
TensorBoard reads up to the first damaged record.
"""

from __future__ import annotations

import contextlib
import logging
import os
import platform
import struct
import time
from collections.abc import Iterator
from itertools import count
from pathlib import Path

from tensorboard.compat.proto.event_pb2 import Event

from common.errors import StorageError, refusal
from common.system.closing import Closing
from learner.run.crc32c import masked_crc32c
from learner.run.disk import DiskWatch
from learner.run.files import replace_bytes, set_aside, sync_descriptor, write_all

logger = logging.getLogger(__name__)

_PREFIX = "events.out.tfevents."
PATTERN = f"{_PREFIX}*"
MAX_WAITING = 1 << 20
"""Bytes of events that wait in memory while the disk is full; the oldest go beyond that."""

_LENGTH = struct.Struct("<Q")
_CHECKSUM = struct.Struct("<I")
_HEAD_BYTES = _LENGTH.size + _CHECKSUM.size
_MAX_EVENT = 64 << 20
_numbers = count()


class EventFile(Closing):
    """One event file, written record by record: each is in it as a whole or not at all.

    What the disk refuses waits for the next record.

    Args:
        folder: made when missing.
        disk: is told when the disk refuses something.

    Raises:
        StorageError: when the disk refuses the file.
    """

    def __init__(self, folder: Path, disk: DiskWatch) -> None:
        name = f"{_PREFIX}{_begin(folder):010d}.{platform.node()}.{os.getpid()}.{next(_numbers):04d}"
        self._path = folder / name
        self._disk = disk
        self._waiting: list[bytes] = []
        self._length = 0
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._descriptor = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o666)
        except OSError as error:
            raise StorageError(f"cannot write {self._path}: {refusal(error)}") from error
        self.add(Event(file_version="brain.Event:2"))

    def add(self, event: Event) -> None:
        """Write one event, which gets the present time."""
        event.wall_time = time.time()
        self._waiting.append(encode_event(event.SerializeToString()))
        self.flush()

    def flush(self) -> None:
        """Write what waits for the disk, as far as that takes it."""
        data = b"".join(self._waiting)
        try:
            write_all(self._descriptor, data)
        except OSError as error:
            with contextlib.suppress(OSError):
                os.ftruncate(self._descriptor, self._length)
            # The first record opens the file, and must not go.
            while len(self._waiting) > 1 and sum(map(len, self._waiting)) > MAX_WAITING:
                del self._waiting[1]
            problem = f"cannot write {self._path}: {refusal(error)}"
            self._disk.refused(StorageError(problem, len(data)))
            return
        self._length += len(data)
        self._waiting = []

    def sync(self) -> None:
        """Bring what is written onto the disk; a refusal is told to the disk watch alone."""
        try:
            sync_descriptor(self._descriptor)
        except OSError as error:
            self._disk.refused(StorageError(f"cannot sync {self._path}: {refusal(error)}"))

    def close(self) -> None:
        """Write what waits and close; safe to call twice."""
        if self._descriptor >= 0:
            self.flush()
            os.close(self._descriptor)
            self._descriptor = -1


def _begin(folder: Path) -> int:
    """Return the second in a new file's name: files are read in the order of their names.

    After a clock was set back a file that is named by it would be read before those that it continues.
    """
    seconds = (path.name.removeprefix(_PREFIX).partition(".")[0] for path in folder.glob(PATTERN))
    return max([round(time.time()), *(int(digits) + 1 for digits in seconds if digits.isdecimal())])


def encode_event(event: bytes) -> bytes:
    """Return the record of a serialised event."""
    length = _LENGTH.pack(len(event))
    return length + _checksum(length) + event + _checksum(event)


def sound_parts(content: bytes) -> Iterator[tuple[int, int]]:
    """Yield (start, end) of each whole record, those behind damage included."""
    position = 0
    while position + _HEAD_BYTES <= len(content):
        end = _end_of_record(content, position)
        if end:
            yield position, end
        position = end or position + 1


def read_events(content: bytes) -> Iterator[Event]:
    """Yield the events of a file, those behind damage included.

    Raises:
        DecodeError: a sound record holds no event.
    """
    for start, end in sound_parts(content):
        yield Event.FromString(content[start + _HEAD_BYTES : end - _CHECKSUM.size])


def mend_events(path: Path, aside: Path, *, dry: bool = False) -> int:
    """Set the bytes of an event file aside that are no records, so that TensorBoard reads all others.

    Args:
        path: of the file.
        aside: folder for what is taken out.
        dry: only count.

    Returns:
        Number of bytes that are no records.
    """
    content = path.read_bytes()
    parts = list(sound_parts(content))
    lost = len(content) - sum(end - start for start, end in parts)
    if lost and not dry:
        edges = [0, *(edge for part in parts for edge in part), len(content)]
        gaps = zip(edges[::2], edges[1::2], strict=True)
        set_aside(aside, f"{path.name}.bin", b"".join(content[start:end] for start, end in gaps))
        replace_bytes(path, b"".join(content[start:end] for start, end in parts))
    return lost


def mend_folder(folder: Path, aside: Path) -> None:
    """Mend the event files of a folder and say what was lost; what a full disk keeps from being mended is said too."""
    for path in sorted(folder.glob(PATTERN)):
        try:
            lost = mend_events(path, aside)
        except OSError as error:
            logger.error(
                "cannot repair %s: %s; run `hd-learner doctor --repair` once there is space", path, error.strerror
            )
            continue
        if lost:
            logger.error("%s: %d damaged bytes hid the points behind them; they are kept in %s", path, lost, aside)


def _end_of_record(content: bytes, position: int) -> int:
    """Where the sound record at ``position`` ends, 0 when there is none."""
    head = content[position : position + _LENGTH.size]
    (length,) = _LENGTH.unpack(head)
    start = position + _HEAD_BYTES
    end = start + length + _CHECKSUM.size
    if length > _MAX_EVENT or end > len(content) or content[position + _LENGTH.size : start] != _checksum(head):
        return 0
    event = content[start : start + length]
    return end if content[start + length : end] == _checksum(event) else 0


def _checksum(data: bytes) -> bytes:
    return _CHECKSUM.pack(masked_crc32c(data))
