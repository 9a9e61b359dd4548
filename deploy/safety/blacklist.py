"""Places that could not be reached are left alone for a while."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, inf
from typing import Final

from deploy.config import Point, SafetyConfig

_LONGEST: Final = 8.0
# Failures are forgotten this many blacklist times after a ban has ended.
_MEMORY: Final = 4.0
# A place that could not be reached so often is out of reach for good.
_HOPELESS: Final = 2
# A robot that has nothing left but banned places tries them so often in the time of a ban.
_TRIES: Final = 6


@dataclass(slots=True)
class Ban:
    """One place.

    Attributes:
        position: (x, y) in the map frame, metres.
        reason: why it is here.
        failures: how often it could not be reached.
        until: time at which the ban ends, seconds of the caller's clock.
        began: time at which it was banned last.
        lifted: time at which the ban would have ended that was lifted before.
    """

    position: Point
    reason: str
    failures: int
    until: float
    began: float = 0.0
    lifted: float = -inf


class Blacklist:
    """Places to leave alone, each for `safety.blacklist_time`, twice as long after every further failure.

    A ban lasts at most 8 times as long, and a place's failures are forgotten 4 blacklist times after its last ban
    has ended: a door that was closed may be open later.
    """

    def __init__(self, config: SafetyConfig, radius: float) -> None:
        """Take positions within `radius` metres of each other for the same place."""
        self.radius = radius
        self._seconds = config.blacklist_time
        self._bans: list[Ban] = []

    def add(self, position: Point, reason: str, now: float) -> Ban:
        """Ban a place from now on; one whose ban was lifted early until that would have ended, as the same failure."""
        self._forget(now)
        ban = self._nearest(position)
        if ban is None:
            ban = Ban(position, reason, 0, now)
            self._bans.append(ban)
        ban.reason, ban.began = reason, now
        if ban.lifted > now:
            ban.until = ban.lifted
            return ban
        ban.failures += 1
        ban.until = now + self._seconds * min(2.0 ** (ban.failures - 1), _LONGEST)
        return ban

    def banned(self, position: Point, now: float) -> Ban | None:
        """The ban that a position falls under, or None."""
        return next((ban for ban in self.active(now) if self._same(ban, position)), None)

    def active(self, now: float) -> list[Ban]:
        """All bans of this moment."""
        return [ban for ban in self._bans if ban.until > now]

    def hopeful(self, now: float) -> list[Ban]:
        """The bans of this moment whose places are worth another try."""
        return [ban for ban in self.active(now) if ban.failures < _HOPELESS]

    def try_again(self, now: float) -> tuple[Ban, float] | None:
        """Let a robot that has nothing else to do look in between whether who stood in its way has gone.

        Returns:
            The ban of the place that is tried first, and in how many seconds: at 0 the ban is lifted. None where no
            place is worth another try.
        """
        bans = self.hopeful(now)
        if not bans:
            return None
        after = self._seconds / _TRIES
        first = min(bans, key=lambda ban: min(ban.until, ban.began + after))
        seconds = max(min(first.until, first.began + after) - now, 0.0)
        if not seconds:
            first.lifted = max(first.lifted, first.until)
            first.until = now
        return first, seconds

    def clear(self) -> None:
        """Forget everything."""
        self._bans.clear()

    def _same(self, ban: Ban, position: Point) -> bool:
        return hypot(ban.position[0] - position[0], ban.position[1] - position[1]) <= self.radius

    def _nearest(self, position: Point) -> Ban | None:
        near = [ban for ban in self._bans if self._same(ban, position)]
        return min(
            near, key=lambda ban: hypot(ban.position[0] - position[0], ban.position[1] - position[1]), default=None
        )

    def _forget(self, now: float) -> None:
        self._bans = [ban for ban in self._bans if max(ban.until, ban.lifted) + _MEMORY * self._seconds > now]
