"""What became of sensor messages, for their operator: counts, the last problem, and each line of the log once."""

from __future__ import annotations

import logging
import time
from collections import Counter
from typing import Final

from common.system.logs import lasting

logger = logging.getLogger(__name__)

# Notes come from outside: more different ones than a robot can have are not told.
MAX_NOTES: Final = 100
# What has not been dropped for so long, seconds, is no longer dropped.
GONE_SECONDS: Final = 5.0


class MessageLog:
    """Counts and tells; not thread-safe.

    Attributes:
        received: number of messages that came.
        dropped: how many were dropped, by reason.
        problem: the last thing that went wrong, in words; empty when nothing did.
    """

    def __init__(self) -> None:
        """Begin with nothing received."""
        self.received = 0
        self.dropped: Counter[str] = Counter()
        self.problem = ""
        self._dropped_at: dict[str, float] = {}
        self._noted: set[str] = set()

    def warn(self, problem: str) -> None:
        """Keep a problem that drops nothing, and log it when it is new."""
        if problem != self.problem:
            logger.warning("%s", problem)
        self.problem = problem

    def note(self, note: str) -> None:
        """Keep what an operator has to know, and log it, once; nothing for an empty text."""
        if note and note not in self._noted and len(self._noted) < MAX_NOTES:
            self._noted.add(note)
            self.warn(note)

    def drop(self, reason: str, problem: str) -> None:
        """Count a message that was dropped, and say why in the log when it is the first one for that reason.

        Args:
            reason: what is wrong, in a word or two.
            problem: the same in a sentence.
        """
        self.dropped[reason] += 1
        self._dropped_at[reason] = time.monotonic()
        self.problem = problem
        if self.dropped[reason] == 1:
            goes_on = lasting(lambda: time.monotonic() - self._dropped_at[reason] < GONE_SECONDS)
            logger.warning("%s (only the first is reported): %s", reason, problem, extra=goes_on)
