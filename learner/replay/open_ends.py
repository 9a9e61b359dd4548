"""Where the chunks of an episode are waiting for the chunk before or after them."""

from __future__ import annotations

StepKey = tuple[str, int, int, int]
"""One step of the whole system: (actor, incarnation, episode, step)."""


class OpenEnds:
    """Observations at one end of their chunk, by the step at which the neighbouring chunk joins them.

    Usage::

        ends = OpenEnds()
        ends.note(("actor-0", 1, 7, 16), number=41)
        ends.take(("actor-0", 1, 7, 16))    # 41, and no longer open
    """

    def __init__(self) -> None:
        self._number_of: dict[StepKey, int] = {}
        self._key_of: dict[int, StepKey] = {}

    def note(self, key: StepKey, number: int) -> None:
        """Note an open end; a confused actor may have sent the same step under two sequence numbers.

        Args:
            key: the step.
            number: arrival number of the observation.
        """
        replaced = self._number_of.get(key)
        if replaced is not None:
            del self._key_of[replaced]
        self._number_of[key] = number
        self._key_of[number] = key

    def take(self, key: StepKey) -> int | None:
        """Return the observation that waits at a step, and forget it; None when there is none."""
        number = self._number_of.pop(key, None)
        if number is not None:
            del self._key_of[number]
        return number

    def forget(self, number: int) -> None:
        """Let nothing that comes later join an observation."""
        key = self._key_of.pop(number, None)
        if key is not None:
            del self._number_of[key]
