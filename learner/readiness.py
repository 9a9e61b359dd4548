"""Whether the next update may be made, and what the learner waits for when it may not."""

from __future__ import annotations

import logging
import threading
import time

from common.config import RunConfig
from learner.ingest import Ingest
from learner.rate_limiter import RateLimiter
from learner.replay.buffer import ReplayBuffer
from learner.replay.draw import may_draw
from learner.run.disk import DiskWatch

logger = logging.getLogger(__name__)

WAIT_SECONDS = 0.2
"""For which the loop waits at most before it looks at everything else again."""


class Readiness:
    """Looks after the conditions of an update: room on the disk, no earlier learner of the run, data, and the ratio.

    Args:
        config: of the run.
        replay: the replay buffer.
        limiter: holds the declared ratio.
        disk: of the run.
        stop: the run was told to stop.
    """

    def __init__(
        self, config: RunConfig, replay: ReplayBuffer, limiter: RateLimiter, disk: DiskWatch, stop: threading.Event
    ) -> None:
        self._config = config
        self._replay = replay
        self._limiter = limiter
        self._disk = disk
        self._stop = stop
        self._warned_unlabelled = False
        self.held = False
        """Another learner of the run, which began earlier, is on the network: no update is made."""
        self.waiting = False
        """The last look found that something is missing."""

    @property
    def cloning(self) -> bool:
        """Whether the next update only imitates the expert."""
        return self._limiter.updates < self._config.cloning.updates

    def wait(self, ingest: Ingest) -> bool:
        """Wait a moment for all conditions, the data's with each delivery; return whether they hold.

        While the disk of the run is full they do not: what would be learnt could not be kept.
        """
        ready = not self.wait_for_room() and not self._wait_for_earlier() and ingest.wait(self.may_learn, WAIT_SECONDS)
        self.waiting = not ready
        return ready

    def wait_for_room(self) -> bool:
        """Wait a moment when the disk is full; return whether it was."""
        if not self._disk.holds():
            return False
        time.sleep(WAIT_SECONDS)
        return True

    def may_learn(self) -> bool:
        """Whether data and ratio allow an update, and the run was not told to stop."""
        if self._stop.is_set() or not self._limiter.may_update():
            return False
        if may_draw(self._replay, self._config, cloning=self.cloning):
            return True
        if len(self._replay) and not self._warned_unlabelled:
            self._warned_unlabelled = True
            logger.warning(
                "no labelled step received yet, so learning waits: actors label for imitation, for PPO and for "
                "sac.privileged_critic, once they have this configuration"
            )
        return False

    def _wait_for_earlier(self) -> bool:
        """Wait a moment when another learner of the run goes first; return whether one does."""
        if self.held:
            time.sleep(WAIT_SECONDS)
        return self.held
