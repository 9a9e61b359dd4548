"""Figures of a run over time: TensorBoard curves, rates and running means. docs/metrics.md explains each."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from tensorboard.compat.proto.event_pb2 import Event, SessionLog
from tensorboard.compat.proto.summary_pb2 import Summary, SummaryMetadata
from tensorboard.compat.proto.tensor_pb2 import TensorProto

from common.system.closing import Closing
from learner.run.disk import DiskWatch
from learner.run.event_file import EventFile


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


class Curves(Closing):
    """Writes TensorBoard scalars; the horizontal axis is the number of updates.

    Args:
        folder: where the event files go.
        update: updates so far; what an earlier process wrote beyond it is hidden, since it is trained again.
        disk: is told when the disk refuses points; they wait then.

    Raises:
        StorageError: when the disk refuses the file.
    """

    def __init__(self, folder: Path, update: int = 0, disk: DiskWatch | None = None) -> None:
        self._file = EventFile(folder, disk or DiskWatch(folder))
        if update:
            self._file.add(Event(step=update + 1, session_log=SessionLog(status=SessionLog.START)))

    def write(self, update: int, values: Mapping[str, float]) -> None:
        """Write one point of each curve."""
        points = [Summary.Value(tag=name, simple_value=value) for name, value in values.items()]
        self._file.add(Event(step=update, summary=Summary(value=points)))

    def text(self, name: str, content: str) -> None:
        """Write a text, such as the configuration."""
        what = SummaryMetadata(plugin_data=SummaryMetadata.PluginData(plugin_name="text"))
        data = TensorProto(dtype="DT_STRING", string_val=[content.encode()])
        value = Summary.Value(tag=f"{name}/text_summary", metadata=what, tensor=data)
        self._file.add(Event(summary=Summary(value=[value])))

    def flush(self) -> None:
        """Bring all points onto the disk, those that waited for room included."""
        self._file.flush()
        self._file.sync()

    def close(self) -> None:
        """Flush and close; safe to call twice."""
        self._file.close()
