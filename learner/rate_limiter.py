"""The declared ratio of updates to collected steps: neither learner nor actors run ahead of it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

MIN_HOLD = 0.05
MAX_HOLD = 30.0


class RateLimiter:
    """Keeps updates and collected steps at a declared ratio by making the one that is ahead wait.

    The learner updates while ``updates < updates_per_step * steps``. When the actors are more than a tolerance
    ahead, each acknowledgement asks its actor to pause for as long as the learner needs to catch up. Actors are
    never held for a learner that could not update, so the two cannot wait for each other.

    Args:
        updates_per_step: declared ratio.
        tolerance: steps that the actors may run ahead before they are held; at least what one update needs.
        min_steps: steps to collect before the first update.
        clock: monotonic seconds.
    """

    def __init__(
        self,
        updates_per_step: float,
        tolerance: int,
        min_steps: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.updates_per_step = updates_per_step
        self.tolerance = max(float(tolerance), 1.0 / updates_per_step)
        self.min_steps = min_steps
        self._clock = clock
        self._lock = threading.Lock()
        self._steps = 0
        self._updates = 0
        self._filled = 0
        self._fresh_from = 0
        self._paused = False
        self._last_update: float | None = None
        self._update_seconds = 0.0

    @property
    def steps(self) -> int:
        """Collected steps so far."""
        return self._steps

    @property
    def updates(self) -> int:
        """Updates so far."""
        return self._updates

    @property
    def actual(self) -> float:
        """Updates per collected step so far; 0 before the first step."""
        return self._updates / self._steps if self._steps else 0.0

    @property
    def lead(self) -> float:
        """Collected steps that still wait for their updates; negative while the learner is ahead."""
        return self._steps - self._updates / self.updates_per_step

    @property
    def paused(self) -> bool:
        """Whether training is paused by command."""
        return self._paused

    @paused.setter
    def paused(self, value: bool) -> None:
        with self._lock:
            self._paused = value
            self._last_update = None

    def restore(self, steps: int, updates: int, filled: int = 0, fresh_from: int = 0) -> None:
        """Continue with the counts of an earlier process.

        Args:
            steps: collected so far.
            updates: made so far.
            filled: transitions in the replay buffer.
            fresh_from: count of steps at which the replay buffer began anew; `min_steps` are collected from there
                before the next update.
        """
        with self._lock:
            self._steps, self._updates, self._filled = steps, updates, filled
            self._fresh_from = fresh_from
            self._last_update = None

    def note_steps(self, steps: int, filled: int) -> None:
        """Count collected steps; ``filled`` is the number of transitions in the replay buffer."""
        with self._lock:
            self._steps += steps
            self._filled = filled

    def note_update(self) -> None:
        """Count one update."""
        with self._lock:
            self._updates += 1
            now = self._clock()
            if self._last_update is not None:
                seconds = now - self._last_update
                known = self._update_seconds
                self._update_seconds = seconds if known == 0.0 else 0.9 * known + 0.1 * seconds
            self._last_update = now

    def may_update(self) -> bool:
        """Whether the ratio allows one more update now."""
        with self._lock:
            return self._ready() and self._updates < self.updates_per_step * self._steps

    def hold(self) -> float:
        """Seconds that the actor whose chunk is being acknowledged should pause; 0 while nothing is ahead."""
        with self._lock:
            if self._paused:
                return 1.0
            excess = self.lead - self.tolerance
            if excess <= 0 or not self._ready():
                return 0.0
            seconds_per_update = self._update_seconds or 1.0
            return min(MAX_HOLD, max(MIN_HOLD, excess * self.updates_per_step * seconds_per_update))

    def _ready(self) -> bool:
        return not self._paused and self._filled > 0 and self._steps - self._fresh_from >= self.min_steps
