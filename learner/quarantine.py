"""What training cannot learn from: set aside with its sources named, so that one bad message never ends a run."""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from collections.abc import Mapping
from typing import Any

from common.errors import CheckpointError, HDError
from learner.algorithm.base import NotFiniteError
from learner.algorithm.batch import TransitionBatch
from learner.replay.buffer import ReplayBuffer, Source

logger = logging.getLogger(__name__)

STRIKES = 5
"""Messages of one actor that are set aside before it is refused."""
PATIENCE = 20
"""Batches in a row without a message to blame, after which it is the weights that have diverged, not the data."""
_MAX_KEPT = 10_000


class Quarantine:
    """Takes the batches of updates that were not finite; safe between threads.

    The messages that cause it by themselves are never drawn again, in this process and in those that resume the run
    from a checkpoint after this. Actors that send such things again and again are refused.

    Args:
        replay: the replay buffer.
    """

    def __init__(self, replay: ReplayBuffer) -> None:
        self._replay = replay
        self._lock = threading.Lock()
        self._aside: OrderedDict[Source, None] = OrderedDict()
        self._strikes: OrderedDict[str, int] = OrderedDict()
        self._in_a_row = 0

    def __contains__(self, source: Source) -> bool:
        with self._lock:
            return source in self._aside

    def __len__(self) -> int:
        return len(self._aside)

    def note_sound(self) -> None:
        """Take note that an update was finite."""
        self._in_a_row = 0

    def take(self, batch: TransitionBatch, problem: NotFiniteError, update: int) -> None:
        """Set aside what an update could not learn from.

        Args:
            batch: of the update, drawn from the buffer.
            problem: what the update raised.
            update: its number.

        Raises:
            HDError: so many batches in a row were not finite that the weights must have diverged.
        """
        found = batch.arrivals is not None and len(problem.culprits)
        self._in_a_row = 0 if found else self._in_a_row + 1
        if self._in_a_row >= PATIENCE:
            raise HDError(
                f"update {update} has diverged ({problem}, and so were the {PATIENCE - 1} batches before): lower the "
                "learning rates (--set adam.policy=..., adam.critic=...) and resume from the last checkpoint"
            )
        if batch.arrivals is None or not found:
            logger.error("update %d gave up its batch: %s, but no message is the cause by itself", update, problem)
            return
        sources = self._replay.set_aside(batch.arrivals[problem.culprits])
        logger.error(
            "update %d discarded its batch: %s; permanently excluded: %s",
            update,
            problem,
            ", ".join(f"message {sequence} of {actor} (incarnation {number})" for actor, number, sequence in sources)
            or "what has left the buffer since",
        )
        for source in sources:
            self._set_aside(source)

    def refusal(self, actor: str) -> str:
        """Return why nothing of an actor is taken any more; empty while it is."""
        with self._lock:
            strikes = self._strikes.get(actor, 0)
        if strikes < STRIKES:
            return ""
        return f"{actor} is refused: {strikes} of its messages made an update not finite; look for its defect"

    def state(self) -> dict[str, Any]:
        """Return all that `restore` needs, ready for JSON."""
        with self._lock:
            return {"aside": [list(source) for source in self._aside], "strikes": dict(self._strikes)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Replace the content by that of a `state`; raise CheckpointError when it is malformed."""
        try:
            aside = OrderedDict(
                ((str(actor), int(number), int(sequence)), None) for actor, number, sequence in state["aside"]
            )
            strikes = OrderedDict((str(actor), int(count)) for actor, count in state["strikes"].items())
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise CheckpointError(f"the saved list of messages that were set aside cannot be read: {error}") from None
        with self._lock:
            self._aside, self._strikes = aside, strikes

    def _set_aside(self, source: Source) -> None:
        actor = source[0]
        with self._lock:
            if source in self._aside:
                return
            self._aside[source] = None
            self._strikes[actor] = self._strikes.get(actor, 0) + 1
            self._strikes.move_to_end(actor)
            for kept in (self._aside, self._strikes):
                if len(kept) > _MAX_KEPT:
                    kept.popitem(last=False)
            strikes = self._strikes[actor]
        if strikes == STRIKES:
            logger.error("%s", self.refusal(actor))
