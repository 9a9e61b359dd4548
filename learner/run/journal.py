"""The journal of a run: every accepted message, in the order of acceptance.

What is appended survives the death of the process at once, and a power failure once `sync` has returned; `GroupCommit`
syncs for many messages at a time, before they are acknowledged. The journal is also the snapshot of the replay buffer:
its segments stay as long as the buffer holds something of them, so a checkpoint writes no experience a second time.

The form of the segments is in `learner.run.records`, what becomes of damage in `learner.run.repair`.
"""

from __future__ import annotations

import contextlib
import logging
import os
import threading
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from common.errors import CheckpointError, StorageError, refusal
from common.system.closing import Closing
from learner.run.disk import DiskWatch
from learner.run.files import DAMAGED, make_folder, remove_leftovers, sync_descriptor, sync_path, write_all
from learner.run.records import (
    Found,
    RecordKind,
    encode_record,
    new_marker,
    scan,
    segment_name,
    segment_paths,
)
from learner.run.repair import Loss, mend, review

logger = logging.getLogger(__name__)

SEGMENT_BYTES = 64 << 20
MAX_UNSYNCED = 256 << 20
"""Bytes that may wait for the disk; beyond them nothing more is taken until it has caught up."""


class Record(NamedTuple):
    """One record of the journal."""

    segment: int
    kind: RecordKind
    payload: bytes


class _Open(NamedTuple):
    """A segment that is written or has just been, with the descriptor that syncs it."""

    path: Path
    descriptor: int


class Journal(Closing):
    """Append-only segments in a folder; one process at a time (the run folder's lock sees to that).

    Opening mends what the last process left: it cuts off the beginning of a record that its writer could not finish,
    and takes damaged bytes out of the segments into a folder of their own, `losses` says which.

    `append` and `sync` may be called from different threads; neither waits for the other, unless more than
    `MAX_UNSYNCED` bytes wait for the disk.

    Usage::

        with Journal(folder) as journal:
            journal.append(RecordKind.DELIVERY, payload)
            journal.sync()
            position = journal.rotate()      # a checkpoint covers everything before this segment

    Args:
        folder: made when missing.
        segment_bytes: a new segment begins beyond this size.
        disk: is told when the disk refuses something.
        aside: folder for damaged bytes; the folder `damaged` beside ``folder`` when not given.

    Raises:
        StorageError: when the disk refuses a new segment.
    """

    def __init__(
        self,
        folder: Path,
        segment_bytes: int = SEGMENT_BYTES,
        disk: DiskWatch | None = None,
        aside: Path | None = None,
    ) -> None:
        self._folder = folder
        self._segment_bytes = segment_bytes
        self._disk = disk or DiskWatch(folder)
        self._lock = threading.Lock()
        self._syncing = threading.Lock()
        self._caught_up = threading.Condition(self._lock)
        self._finished: list[_Open] = []
        self._unsynced: deque[tuple[int, RecordKind, bytes]] = deque()
        self._unsynced_bytes = 0
        self._failed = False
        self._entries_changed = True
        self._number = 0
        self.losses: list[Loss] = []
        """What was found damaged on opening, oldest first."""
        try:
            make_folder(folder)
            remove_leftovers(folder)
            self._mend(aside or folder.parent / DAMAGED)
            existing = self.segments()
            self._segment = existing[-1] + 1 if existing else 1
            self._open = self._open_segment()
        except OSError as error:
            raise StorageError(f"cannot open the journal {folder}: {refusal(error)}") from error
        self._size = 0

    @property
    def segment(self) -> int:
        """Number of the segment that is being written."""
        return self._segment

    def segments(self) -> list[int]:
        """Numbers of all segments, ascending."""
        return sorted(segment_paths(self._folder))

    def append(self, kind: RecordKind, payload: bytes) -> None:
        """Write one record; it survives the death of this process once this returns.

        Raises:
            StorageError: when the disk refuses it; the journal then is as it was before.
        """
        with self._lock:
            self._wait_for_the_disk(len(payload))
            self._write(kind, payload)
            self._unsynced.append((self._number - 1, kind, payload))
            self._unsynced_bytes += len(payload)
            if self._size >= self._segment_bytes:
                with contextlib.suppress(StorageError):
                    # The record is written; the next one tries again to begin a segment.
                    self._rotate()

    def rotate(self) -> int:
        """Begin a new segment and return its number; everything written so far lies before it."""
        with self._lock:
            return self._rotate()

    @property
    def unsynced(self) -> bool:
        """Whether something waits for `sync`."""
        return bool(self._unsynced)

    def sync(self) -> None:
        """Bring everything that was appended before this call onto the disk.

        A disk that fails here may have lost any of it, so what was not synced before is written again, into a new
        segment; reading counts a delivery once, however often it is there.

        Raises:
            StorageError: when the disk refuses it; the next call tries again.
        """
        with self._syncing:
            with self._lock:
                if self._failed:
                    self._write_again()
                number = self._number
                try:
                    current = os.dup(self._open.descriptor)
                except OSError as error:  # too many open files, which may pass
                    raise self._refused("sync", error, 0) from error
                finished, self._finished = self._finished, []
                entries, self._entries_changed = self._entries_changed, False
            try:
                for segment in finished:
                    sync_descriptor(segment.descriptor)
                sync_descriptor(current)
                if entries:
                    sync_path(self._folder)
            except OSError as error:
                with self._lock:
                    self._failed = True
                    self._caught_up.notify_all()
                raise self._refused("sync", error, self._unsynced_bytes) from error
            finally:
                os.close(current)
                for segment in finished:
                    os.close(segment.descriptor)
            with self._lock:
                while self._unsynced and self._unsynced[0][0] < number:
                    self._unsynced_bytes -= len(self._unsynced.popleft()[2])
                self._caught_up.notify_all()

    def drop_before(self, segment: int) -> None:
        """Delete the segments with a lower number."""
        for number, path in segment_paths(self._folder).items():
            if number < min(segment, self._segment):
                path.unlink()

    def read(self, first: int = 0) -> Iterator[Record]:
        """Yield the records of all finished segments from number ``first`` on, in the order of writing.

        Raises:
            CheckpointError: when a segment is damaged, or from another release.
        """
        for number in self.segments():
            if first <= number < self._segment:
                yield from self.read_segment(number)

    def read_segment(self, number: int) -> Iterator[Record]:
        """Yield the records of one finished segment.

        Raises:
            CheckpointError: where the segment has been damaged since the journal was opened, or is of another release.
        """
        path = segment_paths(self._folder)[number]
        for found in scan(path):
            if not isinstance(found, Found):
                raise CheckpointError(
                    f"{path} has been damaged at byte {found.start} since it was opened: restart to repair it"
                )
            try:
                yield Record(number, RecordKind(found.kind), found.payload)
            except ValueError:
                raise CheckpointError(
                    f"{path}: a record is of the unknown kind {found.kind}: resume with the software that wrote it"
                ) from None

    def close(self) -> None:
        """Sync and close; safe to call twice. What a full disk does not take is said and left."""
        if self._open.descriptor < 0:
            return
        try:
            self.sync()
        except StorageError as error:
            logger.error("%s; what was not acknowledged will be sent again", error)
        with self._lock:
            for segment in [*self._finished, self._open]:
                os.close(segment.descriptor)
            if not self._size:
                self._open.path.unlink(missing_ok=True)
            self._finished, self._open = [], self._open._replace(descriptor=-1)

    # --- writing; all with the lock held -----------------------------------------------------------------------

    def _write(self, kind: RecordKind, payload: bytes) -> None:
        record = encode_record(self._marker, self._number, kind, payload)
        try:
            write_all(self._open.descriptor, record)
        except OSError as error:
            try:
                os.ftruncate(self._open.descriptor, self._size)
            except OSError:
                # What is there of the record stays, and reading passes over it.
                self._size = os.fstat(self._open.descriptor).st_size
            raise self._refused("write to", error, len(record)) from error
        self._number += 1
        self._size += len(record)

    def _rotate(self) -> int:
        if self._size:
            try:
                self._segment += 1
                fresh = self._open_segment()
            except OSError as error:
                self._segment -= 1
                raise self._refused("start a segment of", error, 0) from error
            self._finished.append(self._open)
            self._open, self._size = fresh, 0
        return self._segment

    def _write_again(self) -> None:
        """Write everything that is not on the disk for certain into a new segment."""
        self._rotate()
        again: deque[tuple[int, RecordKind, bytes]] = deque()
        for _, kind, payload in self._unsynced:
            self._write(kind, payload)
            again.append((self._number - 1, kind, payload))
        self._unsynced, self._failed = again, False

    def _wait_for_the_disk(self, size: int) -> None:
        def may_write() -> bool:
            return self._failed or not self._unsynced or self._unsynced_bytes + size <= MAX_UNSYNCED

        self._caught_up.wait_for(may_write)
        if self._failed and self._unsynced_bytes + size > MAX_UNSYNCED:
            raise StorageError(f"the journal {self._folder} waits for its disk, which refuses to store", size)

    def _open_segment(self) -> _Open:
        self._marker = new_marker()
        path = self._folder / segment_name(self._segment, self._marker)
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | os.O_CLOEXEC, 0o666)
        self._entries_changed = True
        return _Open(path, descriptor)

    def _refused(self, verb: str, error: OSError, needed: int) -> StorageError:
        problem = StorageError(f"cannot {verb} the journal {self._folder}: {refusal(error)}", needed)
        self._disk.refused(problem)
        return problem

    # --- opening -----------------------------------------------------------------------------------------------

    def _mend(self, aside: Path) -> None:
        """Mend all segments, continue their numbers, and bring everything onto the disk.

        An earlier process may have been killed before it synced what it wrote, and that will be acknowledged now.
        """
        paths = segment_paths(self._folder)
        found = review(paths)
        mend(paths, found, aside)
        self._number, self.losses = found.next_number, found.losses
        if found.torn:
            logger.info("cut %d bytes off the journal, of a record that was never acknowledged", found.torn)
        for loss in self.losses:
            logger.error("lost from the journal: %s; the bytes are kept in %s", loss, aside / loss.file)
        for path in segment_paths(self._folder).values():
            sync_path(path)
