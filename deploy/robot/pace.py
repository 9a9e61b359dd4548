"""Keeps simulated time in step with the clock on the wall, or a number of times faster."""

from __future__ import annotations

import threading
import time
from collections import deque

_WINDOW = 100
_GIVE_UP = 0.5


class Pace:
    """Waits after each step, and measures how fast simulated time really passes."""

    def __init__(self, factor: float) -> None:
        """Begin now; ``factor`` is simulated seconds per second."""
        self._factor = factor
        self._began = time.monotonic()
        self._offset = 0.0
        self._marks: deque[tuple[float, float]] = deque([(self._began, 0.0)], maxlen=_WINDOW)

    @property
    def reached(self) -> float:
        """Simulated seconds per second of late."""
        (wall, simulated), (wall_now, simulated_now) = self._marks[0], self._marks[-1]
        return (simulated_now - simulated) / (wall_now - wall) if wall_now > wall else self._factor

    def wait(self, simulated: float, stop: threading.Event) -> None:
        """Sleep until ``simulated`` seconds are due; a lag of more than half a second is not made up for."""
        ahead = self._began + (simulated - self._offset) / self._factor - time.monotonic()
        if ahead > 0.0:
            stop.wait(ahead)
        elif ahead < -_GIVE_UP:
            self._began, self._offset = time.monotonic(), simulated
        self._marks.append((time.monotonic(), simulated))
