"""The task is over only when several checks in a row, each on a map with news or one that stays as it is, say so."""

from __future__ import annotations

from typing import Final

# A map that is published only when it changes brings no news at the end; one that stayed the same for so long, seconds,
# counts once more.
_STEADY: Final = 3.0


class CompletionChecks:
    """Counts checks that found nothing left to do.

    Usage::

        checks = CompletionChecks(5)
        if checks.passed(map_version, now):
            finish()
    """

    def __init__(self, needed: int) -> None:
        """Ask for so many checks."""
        self.needed = needed
        self.reset()

    def reset(self) -> None:
        """Begin anew, because there is something to do again."""
        self.count = 0
        self._last: tuple[int, float] | None = None

    def passed(self, version: int, now: float) -> bool:
        """Take in a check that found nothing left to do, and say whether it was the last one needed.

        Args:
            version: of the map that was checked, rising with every sensor message in it; a check of the same map
                again tells nothing new and is not counted until that map has stayed for some seconds.
            now: seconds.
        """
        if self._last is None or version > self._last[0] or now - self._last[1] >= _STEADY:
            self._last = version, now
            self.count += 1
        return self.count >= self.needed
