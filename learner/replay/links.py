"""Which step of the replay buffer has its successor there: joined in whatever order the chunks of an episode came."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.messages.experience import Chunk, Delivery, End
from learner.replay.memory import SlotColumns
from learner.replay.open_ends import OpenEnds


class TransitionLinks:
    """Joins each step to its successor as soon as both are here, and parts them when one of them goes.

    Observations are known by their arrival numbers; an observation's row is its number modulo the number of slots.

    Args:
        columns: of the buffer; `successor` and `predecessor` are written here alone.
        slots: number of rows.

    Attributes:
        count: steps whose successor is here, which are transitions.
    """

    def __init__(self, columns: SlotColumns, slots: int) -> None:
        self._columns = columns
        self._slots = slots
        self._ends, self._starts = OpenEnds(), OpenEnds()
        self.count = 0

    def clear(self, rows: NDArray[np.int64]) -> None:
        """Begin rows that are written anew with no link."""
        self._columns.successor[rows] = -1
        self._columns.predecessor[rows] = -1

    def join_to_next(self, steps: NDArray[np.int64]) -> None:
        """Join steps of one chunk to the observation that follows each of them there."""
        self._columns.successor[steps % self._slots] = steps + 1
        self.count += len(steps)

    def join_chunk(self, delivery: Delivery, chunk: Chunk, first: int, oldest: int) -> None:
        """Join the chunk's ends to the chunks before and after it, or note them for when those come.

        Args:
            delivery: that the chunk came with.
            chunk: stored already.
            first: arrival number of its first observation.
            oldest: that of the oldest observation here.
        """
        episode = (delivery.actor, delivery.incarnation, chunk.episode)
        last = first + chunk.steps - 1
        if chunk.end is End.NONE and last >= oldest:
            key = (*episode, chunk.first_step + chunk.steps)
            later = self._starts.take(key)
            if later is None:
                self._ends.note(key, last)
            else:
                self._join(last, later)
        if chunk.first_step > 0 and first >= oldest:
            key = (*episode, chunk.first_step)
            earlier = self._ends.take(key)
            if earlier is None:
                self._starts.note(key, first)
            else:
                self._join(earlier, first)

    def cut_after(self, number: int) -> None:
        """Part an observation that stays here from its successor; nothing that comes later joins it."""
        columns, row = self._columns, number % self._slots
        successor = int(columns.successor[row])
        if successor >= 0:
            columns.successor[row] = -1
            columns.predecessor[successor % self._slots] = -1
            self.count -= 1
        self._forget_ends(number)

    def evict(self, number: int) -> None:
        """Drop the oldest observation from all links, and with it the transition that starts or ends there."""
        columns, row = self._columns, number % self._slots
        if columns.successor[row] >= 0:
            self.count -= 1
        earlier = int(columns.predecessor[row])
        if earlier >= number:  # it arrived after its successor, so it outlives it and is a transition no more
            columns.successor[earlier % self._slots] = -1
            self.count -= 1
        columns.successor[row] = -1
        self._forget_ends(number)

    def _join(self, step: int, successor: int) -> None:
        self._columns.successor[step % self._slots] = successor
        self._columns.predecessor[successor % self._slots] = step
        self.count += 1

    def _forget_ends(self, number: int) -> None:
        self._ends.forget(number)
        self._starts.forget(number)
