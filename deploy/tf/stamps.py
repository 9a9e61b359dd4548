"""The order of a stream's stamps: which messages are new, come again or come late, and when the clock was set back."""

from __future__ import annotations

from enum import Enum, auto
from typing import Final

# Messages of one publisher come in their order, so two that lie behind, the first of them by more than this, seconds,
# are no late ones.
_BEHIND: Final = 0.09
# After a message that was overtaken, stamps continue a period beyond the newest one; so small a share of a period is
# none: then the clock was set back by two periods, and stamps jitter.
_NO_PERIOD: Final = 0.5
# No message comes so late, seconds.
_FAR_BEHIND: Final = 10.0


class Order(Enum):
    """How a stamp lies to those before it."""

    AHEAD = auto()
    """It is the newest."""
    REPEATED = auto()
    """It is the newest one once more: the message tells nothing new."""
    LATE = auto()
    """It lies before the newest one: a message that was overtaken, or the first after the clock was set back."""
    SET_BACK = auto()
    """It is the second in a row that lies before the newest one, or lies far before it: the clock was set back."""


class StampOrder:
    """Follows the stamps of one stream of messages; not thread-safe.

    Usage::

        if order.take(stamp) is Order.SET_BACK:
            forget_what_was_stamped_before()
    """

    def __init__(self) -> None:
        """Know no stamp yet."""
        self._newest: float | None = None
        self._late: float | None = None
        self._period = 0.0

    @property
    def newest(self) -> float | None:
        """The newest stamp, seconds; None before the first."""
        return self._newest

    def take(self, stamp: float) -> Order:
        """Take in the stamp of a message, seconds of the robot's clock, and say how it lies to those before it."""
        newest, late = self._newest, self._late
        if newest is not None:
            in_a_row = (
                late is not None and newest - late > _BEHIND and late < stamp <= newest + _NO_PERIOD * self._period
            )
            if in_a_row or newest - stamp > _FAR_BEHIND:
                self._newest, self._late, self._period = stamp, None, 0.0
                return Order.SET_BACK
        if newest is None or stamp > newest:
            self._period = 0.0 if newest is None else stamp - newest
            self._newest, self._late = stamp, None
            return Order.AHEAD
        if stamp == newest:
            return Order.REPEATED
        self._late = stamp
        return Order.LATE
