"""Which new deliveries a run takes: from whom, and of what kind."""

from __future__ import annotations

from common.bus.seen import MAX_CLOSED, SeenSet
from common.config import RunConfig
from common.errors import RefusedError
from common.messages.experience import Chunk, Delivery
from learner.quarantine import Quarantine


class Admission:
    """Refuses what must not get into journal and replay buffer, although it is a valid message.

    Args:
        config: of the run; says whether observations have images, and labels hints.
        quarantine: knows the actors of which nothing is taken any more.
        seen: knows the actor processes that have delivered before.
    """

    def __init__(self, config: RunConfig, quarantine: Quarantine, seen: SeenSet) -> None:
        self._images = config.network.reads_image
        self._hints = config.hinted
        self._quarantine = quarantine
        self._seen = seen

    def check(self, delivery: Delivery) -> None:
        """Raise RefusedError when nothing new of its actor may be stored, or not this."""
        refusal = self._quarantine.refusal(delivery.actor)
        if refusal:
            raise RefusedError(refusal)
        if self._seen.full and not self._seen.knows(delivery.actor, delivery.incarnation):
            raise RefusedError(
                f"this run has had {MAX_CLOSED:,} actor processes and accepts no more: a client invents names; use "
                "certificates (docs/bus.md), and start another run"
            )
        if not isinstance(delivery.body, Chunk):
            return
        if (delivery.body.observations.image is not None) != self._images:
            raise RefusedError(
                f"observations of this run must have {'an' if self._images else 'no'} image (network.variant, "
                "network.belief_map): make them as the run's specification says"
            )
        labels = delivery.body.labels
        if labels is not None and (labels.gain is not None) != self._hints:
            raise RefusedError(
                f"labels of this run must have {'' if self._hints else 'no '}hints (cloning.auxiliary_weight): make "
                "them as the run's specification says"
            )
