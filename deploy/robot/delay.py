"""Messages that come later than they are made."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable


class DelayLine:
    """Does things a fixed time after they were asked for, in their order."""

    def __init__(self, latency: float) -> None:
        """Set up a latency in seconds; 0 does everything at the next `advance`."""
        self._latency = latency
        self._waiting: deque[tuple[float, Callable[[], None]]] = deque()

    def add(self, time: float, action: Callable[[], None]) -> None:
        """Do something a latency after ``time``."""
        self._waiting.append((time + self._latency, action))

    def advance(self, time: float) -> None:
        """Do what is due by ``time``."""
        while self._waiting and self._waiting[0][0] <= time + 1e-9:
            self._waiting.popleft()[1]()
