"""The time of day that does not jump: for figures over time, and for the order of what is kept; the longest wait."""

from __future__ import annotations

import time
from typing import Final

LONGEST_WAIT: Final = 1e6
"""Seconds, eleven days: longer than anybody waits for anything, and little enough for every timer."""

_BEGAN: Final = time.time_ns() - time.monotonic_ns()


def steady_time(monotonic: float | None = None) -> float:
    """Return seconds since 1970 as this process's clock had them at its start, and counted steadily from there.

    A clock that is set while a process runs (a robot without a clock of its own that hears the network's later) puts
    seconds, or decades, between two moments, or the later one first.

    Args:
        monotonic: a moment of `time.monotonic`, now when not given.
    """
    return steady_time_ns(monotonic) * 1e-9


def steady_time_ns(monotonic: float | None = None) -> int:
    """Return what `steady_time` does in nanoseconds."""
    return _BEGAN + (time.monotonic_ns() if monotonic is None else round(monotonic * 1e9))
