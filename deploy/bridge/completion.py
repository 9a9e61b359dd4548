"""The task is over only when several checks in a row, each on a map with news, say so."""

from __future__ import annotations


class CompletionChecks:
    """Counts checks that found nothing left to do.

    Usage::

        checks = CompletionChecks(5)
        if checks.passed(map_version):
            finish()
    """

    def __init__(self, needed: int) -> None:
        """Ask for so many checks."""
        self.needed = needed
        self.reset()

    def reset(self) -> None:
        """Begin anew, because there is something to do again."""
        self.count = 0
        self._version: int | None = None

    def passed(self, version: int) -> bool:
        """Take in a check that found nothing left to do, and say whether it was the last one needed.

        Args:
            version: of the map that was checked, rising with every sensor message in it; a check of the same map
                again tells nothing new and is not counted.
        """
        if self._version is None or version > self._version:
            self._version = version
            self.count += 1
        return self.count >= self.needed
