"""Figures of a run over time: TensorBoard curves, rates and running means. docs/metrics.md explains each."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from torch.utils.tensorboard import SummaryWriter


class RateMeter:
    """Events per second over the last seconds.

    Args:
        window: seconds.
        clock: monotonic seconds.
    """

    def __init__(self, window: float = 10.0, clock: Callable[[], float] = time.monotonic) -> None:
        self._window = window
        self._clock = clock
        self._began = clock()
        self._events: deque[tuple[float, int]] = deque()
        self._lock = threading.Lock()

    def add(self, count: int = 1) -> None:
        """Count events that happened now."""
        with self._lock:
            self._events.append((self._clock(), count))
            self._forget()

    @property
    def rate(self) -> float:
        """Events per second."""
        with self._lock:
            self._forget()
            seconds = min(self._window, self._clock() - self._began)
            return sum(count for _, count in self._events) / seconds if seconds > 0 else 0.0

    def _forget(self) -> None:
        oldest = self._clock() - self._window
        while self._events and self._events[0][0] < oldest:
            self._events.popleft()


class Means:
    """Means of named values between two readings; safe between threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._sums: dict[str, tuple[float, int]] = {}

    def add(self, values: Mapping[str, float]) -> None:
        """Add one value for each name."""
        with self._lock:
            for name, value in values.items():
                total, count = self._sums.get(name, (0.0, 0))
                self._sums[name] = (total + float(value), count + 1)

    def take(self) -> dict[str, float]:
        """Return the means since the last call and begin anew."""
        with self._lock:
            sums, self._sums = self._sums, {}
        return {name: total / count for name, (total, count) in sums.items()}

    def state(self) -> dict[str, list[float]]:
        """Return the values since the last reading, ready for JSON."""
        with self._lock:
            return {name: [total, count] for name, (total, count) in self._sums.items()}

    def restore(self, state: Mapping[str, Sequence[float]]) -> None:
        """Take over the values of an earlier process."""
        with self._lock:
            self._sums = {name: (float(total), int(count)) for name, (total, count) in state.items()}


class Curves:
    """Writes TensorBoard scalars; the horizontal axis is the number of updates.

    Args:
        folder: where the event files go.
        update: updates so far; what an earlier process wrote beyond it is hidden, since it is trained again.
    """

    def __init__(self, folder: Path, update: int = 0) -> None:
        self._writer = SummaryWriter(str(folder), purge_step=update + 1 if update else None, flush_secs=30)

    def write(self, update: int, values: Mapping[str, float]) -> None:
        """Write one point of each curve."""
        for name, value in values.items():
            self._writer.add_scalar(name, value, update)

    def text(self, name: str, content: str) -> None:
        """Write a text, such as the configuration."""
        self._writer.add_text(name, content)

    def flush(self) -> None:
        """Bring all points to the files."""
        self._writer.flush()

    def close(self) -> None:
        """Flush and close; safe to call twice."""
        self._writer.close()
