"""The last problem that was logged, so that the status can tell it."""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

from common.system.closing import Closing
from deploy.bridge.status import Problem

_LONGEST: Final = 300
_KEPT: Final = 32
# What merely happened is told for so long, seconds.
_EVENT_SECONDS: Final = 60.0


class _Entry(NamedTuple):
    time: float
    text: str
    holds: Callable[[], bool] | None


class LastProblem(logging.Handler, Closing):
    """Keeps the newest warnings and errors of this process, each for as long as it matters.

    What a line was logged for may last (`common.system.logs.lasting`): then it counts until that is over. All others
    count for a minute.
    """

    def __init__(self) -> None:
        """Begin to listen to all loggers."""
        super().__init__(logging.WARNING)
        self._entries: deque[_Entry] = deque(maxlen=_KEPT)
        logging.getLogger().addHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        """Take a log record."""
        text = record.getMessage()[:_LONGEST]
        self._entries.append(_Entry(time.monotonic(), text, getattr(record, "holds", None)))

    @property
    def problem(self) -> Problem | None:
        """The newest one that is not over; None without."""
        now = time.monotonic()
        for entry in reversed(tuple(self._entries)):
            if entry.holds() if entry.holds is not None else now - entry.time < _EVENT_SECONDS:
                return Problem(entry.text, now - entry.time)
        return None

    def close(self) -> None:
        """Listen no more. Safe to call twice."""
        logging.getLogger().removeHandler(self)
        super().close()
