"""A lock between processes that share a folder."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from common.errors import LockedError
from common.system.closing import Closing


class FileLock(Closing):
    """Held by one process at a time, until it is closed or the process ends, however that ends.

    The file stays: it holds the number of the process that took the lock last, and deleting it would let two processes
    hold one lock each.

    Usage::

        with FileLock(folder / "lock"):
            ...
    """

    def __init__(self, path: Path, *, read_only: bool = False) -> None:
        """Take the lock.

        Args:
            path: of the lock's file; made when missing, its folder must be there.
            read_only: share the lock with others that only read, and write nothing: the folder may belong to somebody
                else. Whoever writes is kept out all the same. The file must be there.

        Raises:
            LockedError: another process holds it.
            OSError: the file cannot be made or written, or not be read.
        """
        access = os.O_RDONLY if read_only else os.O_RDWR | os.O_CREAT
        self._descriptor = os.open(path, access | os.O_CLOEXEC, 0o666)
        try:
            fcntl.flock(self._descriptor, (fcntl.LOCK_SH if read_only else fcntl.LOCK_EX) | fcntl.LOCK_NB)
            if not read_only:
                os.ftruncate(self._descriptor, 0)
                os.pwrite(self._descriptor, f"{os.getpid()}\n".encode(), 0)
        except BlockingIOError:
            holder = os.pread(self._descriptor, 32, 0).decode("ascii", "replace").strip()
            self.close()
            raise LockedError(path, holder or "unknown") from None
        except OSError:
            self.close()
            raise

    def close(self) -> None:
        """Give the lock back; safe to call twice."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1
