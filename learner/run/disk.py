"""Whether the disk of a run takes what is written: the learner holds while it does not."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
import time
from pathlib import Path

from common.errors import StorageError

logger = logging.getLogger(__name__)

_LEAST_ROOM = 1 << 20
_PROBE_SECONDS = 1.0


class DiskWatch:
    """Says once that the disk refuses something, holds until there is room for it, and says that once too.

    Whoever writes reports a refusal and keeps what it could not write; whoever wants to continue asks `holds`.

    Args:
        folder: on the disk in question; must exist when something is refused.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        self._full = False
        self._needed = _LEAST_ROOM
        self._probe_at = 0.0

    @property
    def full(self) -> bool:
        """Whether something was refused and there is no room for it yet."""
        return self._full

    def refused(self, error: StorageError) -> None:
        """Report that the disk refused something."""
        with self._lock:
            self._needed = max(self._needed, error.needed + _LEAST_ROOM)
            if self._full:
                return
            self._full = True
            self._probe_at = time.monotonic() + _PROBE_SECONDS
        logger.error("%s. The learner pauses, accepts nothing, and continues as soon as there is space", error)

    def holds(self) -> bool:
        """Whether to wait; looks once a second whether there is room again."""
        with self._lock:
            if not self._full or time.monotonic() < self._probe_at:
                return self._full
            self._probe_at = time.monotonic() + _PROBE_SECONDS
            if not self._has_room():
                return True
            self._full, self._needed = False, _LEAST_ROOM
        logger.info("there is space on the disk again: continuing")
        return False

    def _has_room(self) -> bool:
        """Reserve the room and give it back: free space alone would not tell of quotas."""
        path = self._folder / f".room.{os.getpid()}.tmp"
        try:
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o600)
            try:
                if hasattr(os, "posix_fallocate"):
                    os.posix_fallocate(descriptor, 0, self._needed)
                else:
                    os.write(descriptor, bytes(self._needed))
            finally:
                os.close(descriptor)
        except OSError:
            return False
        finally:
            with contextlib.suppress(OSError):
                path.unlink()
        return True
