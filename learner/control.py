"""Commands that reach a running learner over the bus: status, pause, resume, checkpoint, stop."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

from common.errors import HDError
from common.messages.replies import ControlRequest
from learner.trainer import Trainer
from learner.watch.status import LearnerStatus

logger = logging.getLogger(__name__)

CHECKPOINT_SECONDS = 60.0


class Control:
    """Carries commands out and answers with the status after them: a page of it, see `LearnerStatus.page`.

    Args:
        trainer: what is commanded.
        status: makes the status.
    """

    def __init__(self, trainer: Trainer, status: Callable[[], LearnerStatus]) -> None:
        self._trainer = trainer
        self._status = status
        self._verbs: dict[str, Callable[[], None]] = {
            "status": lambda: None,
            "pause": trainer.pause,
            "resume": trainer.unpause,
            "checkpoint": self._checkpoint,
            "stop": trainer.stop,
        }

    def __call__(self, request: ControlRequest) -> dict[str, Any]:
        """Carry one command out.

        Raises:
            HDError: when it is unknown or could not be carried out.
        """
        act = self._verbs.get(request.verb)
        if act is None:
            raise HDError(f"expected one of {', '.join(self._verbs)}, got {request.verb!r}")
        if request.verb != "status":
            logger.info("command: %s", request.verb)
        act()
        return self._status().page(str(request.arguments.get("after", "")))

    def _checkpoint(self) -> None:
        if not self._trainer.request_checkpoint(CHECKPOINT_SECONDS):
            raise HDError(
                f"the checkpoint was not written within {CHECKPOINT_SECONDS:.0f} s, or the disk refused the run's last "
                "one: see the learner's log"
            )
