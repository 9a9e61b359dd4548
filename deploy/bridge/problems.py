"""The last problem that was logged, so that the status can tell it."""

from __future__ import annotations

import logging
import time

from common.system.closing import Closing
from deploy.bridge.status import Problem

_LONGEST = 300


class LastProblem(logging.Handler, Closing):
    """Keeps the newest warning or error of this process."""

    def __init__(self) -> None:
        """Begin to listen to all loggers."""
        super().__init__(logging.WARNING)
        self._last: tuple[float, str] | None = None
        logging.getLogger().addHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        """Take a log record."""
        self._last = (time.monotonic(), record.getMessage()[:_LONGEST])

    @property
    def problem(self) -> Problem | None:
        """The newest one; None while there was none."""
        last = self._last
        return None if last is None else Problem(last[1], time.monotonic() - last[0])

    def close(self) -> None:
        """Listen no more. Safe to call twice."""
        logging.getLogger().removeHandler(self)
        super().close()
