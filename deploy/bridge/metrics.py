"""Figures of a task under way, as the CMU stack's planners publish them."""

from __future__ import annotations

from collections import deque

import numpy as np

# Nearer to its start than this a robot counts as not having moved yet, metres.
_FIRST_MOTION = 0.2
_KEPT = 200


class Metrics:
    """Distance, duration and decision times.

    Attributes:
        distance: metres travelled.
        last_decision: time of the last decision, seconds.
    """

    def __init__(self) -> None:
        self.distance = 0.0
        self.last_decision = 0.0
        self._began: float | None = None
        self._ended: float | None = None
        self._times: deque[float] = deque(maxlen=_KEPT)

    def decided(self, seconds: float) -> None:
        """Take in the time of a decision."""
        self.last_decision = seconds
        self._times.append(seconds)

    def moved(self, now: float, distance: float, *, under_way: bool) -> None:
        """Take in how far the robot has come; the clock starts with its first motion and stops when the task ends."""
        self.distance = distance
        if self._began is None and distance >= _FIRST_MOTION:
            self._began = now
        if under_way:
            self._ended = None
        elif self._ended is None:
            self._ended = now

    def duration(self, now: float) -> float:
        """Seconds since the first motion, until the task ended."""
        if self._began is None:
            return 0.0
        return max((now if self._ended is None else self._ended) - self._began, 0.0)

    @property
    def decision_p95(self) -> float:
        """95 % of the last decisions took no longer than this, seconds."""
        return float(np.quantile(np.array(self._times), 0.95)) if self._times else 0.0
