"""Group commit: one sync of the journal for all messages that came since the last."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from common.errors import StorageError
from common.system.closing import Closing
from common.system.threads import Complaints
from learner.run.journal import Journal

logger = logging.getLogger(__name__)

RETRY_SECONDS = 1.0
"""Between two tries on a disk that refuses."""


class GroupCommit(Closing):
    """Syncs a journal in a thread of its own, and tells whoever waits for it.

    A first message is synced at once; those that come within ``interval`` of that wait for the next sync together, so
    the disk is asked no more than once in that time, however many messages come.

    Usage::

        with GroupCommit(journal, interval=0.05) as commit:
            journal.append(RecordKind.DELIVERY, payload)
            commit.when_synced(lambda durable: acknowledge() if durable else None)

    Args:
        journal: is synced.
        interval: seconds from the beginning of one sync to that of the next.
    """

    def __init__(self, journal: Journal, interval: float) -> None:
        self._journal = journal
        self._interval = interval
        self._changed = threading.Condition()
        self._waiting: list[Callable[[bool], None]] = []
        self._closed = False
        self._complaints = Complaints("telling who waits for the journal")
        self._thread = threading.Thread(target=self._work, name="group commit", daemon=True)
        self._thread.start()

    def when_synced(self, tell: Callable[[bool], None]) -> None:
        """Have ``tell`` called in the thread of this object once everything appended so far has its fate.

        That is True when it is on the disk, and False when the disk refused it: it is tried again then, but whoever
        waits should not wait for that.
        """
        with self._changed:
            self._waiting.append(tell)
            self._changed.notify()

    def close(self) -> None:
        """Sync a last time and end. Safe to call twice."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join()

    def _work(self) -> None:
        while True:
            with self._changed:
                # Without anybody waiting the journal is looked at once in every interval.
                self._changed.wait_for(lambda: self._closed or self._waiting, self._interval)
                waiting, self._waiting = self._waiting, []
                closed = self._closed
            began = time.monotonic()
            pause = self._interval
            if waiting or self._journal.unsynced:
                durable = self._sync()
                for tell in waiting:
                    with self._complaints:
                        tell(durable)
                pause = self._interval if durable else RETRY_SECONDS
            if closed:
                return
            self._pause(began + pause - time.monotonic())

    def _sync(self) -> bool:
        try:
            self._journal.sync()
        except StorageError as error:
            logger.debug("%s", error)  # the journal has told its disk watch, which says it once
            return False
        return True

    def _pause(self, seconds: float) -> None:
        with self._changed:
            self._changed.wait_for(lambda: self._closed, max(0.0, seconds))
