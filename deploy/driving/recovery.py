"""What a robot does that makes no way: back off, turn around, and say so."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import inf
from typing import Final

_STEP: Final = 0.08
# Turning on the spot is no standstill, but no way either.
_TURNING_COUNTS: Final = 0.3


class Remedy(Enum):
    """What to try now."""

    NONE = "none"
    BACK_OFF = "back off"
    TURN = "turn"


@dataclass(frozen=True, slots=True)
class Schedule:
    """Seconds without progress at which remedies begin.

    Attributes:
        back_off: reverse slowly.
        turn: look for another way by turning around.
        blocked: say that there is no way.
        again: begin with the first remedy again.
    """

    back_off: float = 2.5
    turn: float = 4.5
    blocked: float = 7.0
    again: float = 10.0


class ProgressWatch:
    """Counts the seconds in which the remaining way does not get shorter."""

    def __init__(self, schedule: Schedule | None = None) -> None:
        self._schedule = schedule or Schedule()
        self.reset()

    def reset(self) -> None:
        """Begin anew."""
        self._best = inf
        self._stalled = 0.0
        self._blocked = False
        self._setting_out = self._fresh = True

    @property
    def blocked(self) -> bool:
        """Whether there has been no way for long."""
        return self._blocked

    def shift(self, metres: float) -> None:
        """Take in that the way is so much longer because it leads elsewhere now: that is no standstill."""
        self._best += metres
        self._setting_out = self._fresh = True

    def update(self, remaining: float, interval: float, *, turning: bool) -> Remedy:
        """Take in the remaining way (metres) and say what to try; `turning` when the robot turns on the spot."""
        if self._setting_out and turning:
            # A way that leads back begins where the robot has rolled to, which is far where it brakes weakly.
            self._best = max(self._best, remaining)
        if remaining < self._best - _STEP:
            self._best = remaining
            self._stalled = 0.0
            self._blocked = False
            # Of a way that has just changed it is not known yet whether the robot has to turn.
            self._setting_out = self._setting_out and (turning or self._fresh)
        else:
            self._stalled += interval * (_TURNING_COUNTS if turning else 1.0)
        self._fresh = False
        schedule = self._schedule
        if self._stalled >= schedule.blocked:
            self._blocked = True
        if self._stalled >= schedule.again:
            # The remaining way is measured anew: backing off has made it longer.
            self._best, self._stalled = remaining, 0.0
        if self._stalled >= schedule.turn and self._stalled < schedule.blocked:
            return Remedy.TURN
        if self._stalled >= schedule.back_off and self._stalled < schedule.turn:
            return Remedy.BACK_OFF
        return Remedy.NONE
