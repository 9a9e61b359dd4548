"""Threads and callbacks that outlive their errors: each error is logged with its cause, and the next round comes."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import ParamSpec, Self

from common.system.closing import Closing

log = logging.getLogger(__name__)

REPEAT_SECONDS = 60.0
"""An error that comes again and again is logged this often, with its number; the first time with its traceback."""

P = ParamSpec("P")


class Complaints:
    """Catches the errors of one thread or callback, and logs them without flooding the log; safe between threads.

    Usage::

        complaints = Complaints("asking for weights")
        while not closed:
            with complaints:
                ask()

    Args:
        what: what may fail, for the log.
        expected: whether errors are no news, because everything is being closed.
    """

    def __init__(self, what: str, expected: Callable[[], bool] = lambda: False) -> None:
        self._what = what
        self._expected = expected
        self._lock = threading.Lock()
        self._last = ("", float("-inf"))
        self._unsaid = 0
        self.count = 0
        """Errors so far."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        if not isinstance(error, Exception):
            return False
        if not self._expected():
            self._note(error)
        return True

    def _note(self, error: Exception) -> None:
        """Log an error, unless the same one was logged a moment ago."""
        kind, now = f"{type(error).__name__}: {error}", time.monotonic()
        with self._lock:
            self.count += 1
            before, at = self._last
            if kind == before and now - at < REPEAT_SECONDS:
                self._unsaid += 1
                return
            self._last, unsaid = (kind, now), self._unsaid
            self._unsaid = 0
        again = f" ({unsaid} errors more since the last line)" if unsaid else ""
        log.error("%s failed and continues: %s%s", self._what, kind, again, exc_info=None if kind == before else error)


def guarded(what: str, act: Callable[P, object]) -> Callable[P, None]:
    """Return ``act`` as a callback from which no error comes: it is logged as one of ``what``."""
    complaints = Complaints(what)

    def call(*arguments: P.args, **named: P.kwargs) -> None:
        with complaints:
            act(*arguments, **named)

    return call


class Ticker(Closing):
    """Does something every few seconds in a thread of its own, whatever becomes of it, until it is closed.

    Usage::

        with Ticker("statistics", 1.0, tell):
            ...

    Args:
        what: name of the thread, and what the log calls it.
        seconds: between two times.
        act: what to do.
    """

    def __init__(self, what: str, seconds: float, act: Callable[[], object]) -> None:
        self._seconds = seconds
        self._act = guarded(what, act)
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name=what, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop; what is being done is finished first. Safe to call twice."""
        self._closed.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._closed.wait(self._seconds):
            self._act()
