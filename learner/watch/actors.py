"""What the learner has received from each actor."""

from __future__ import annotations

import time
from collections import OrderedDict
from dataclasses import dataclass

from common.messages.experience import Chunk, Delivery

_MAX_ACTORS = 10_000


@dataclass(slots=True)
class ActorRecord:
    """What the learner has received from one actor since this process started.

    Attributes:
        steps: stored decisions.
        episodes: finished episodes.
        version: policy version behind its newest step or episode.
        arrived: monotonic seconds of its newest delivery.
    """

    steps: int = 0
    episodes: int = 0
    version: int = -1
    arrived: float = 0.0


class ActorRecords(OrderedDict[str, ActorRecord]):
    """The actors heard last, by name, at most 10,000."""

    def note(self, delivery: Delivery) -> None:
        """Count a delivery that was stored."""
        record = self.setdefault(delivery.actor, ActorRecord())
        self.move_to_end(delivery.actor)
        if len(self) > _MAX_ACTORS:
            self.popitem(last=False)
        record.arrived = time.monotonic()
        body = delivery.body
        if isinstance(body, Chunk):
            record.steps += body.steps
            record.version = int(body.versions[-1])
        else:
            record.episodes += 1
            record.version = body.version
