"""Policy versions on their way to the actors."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable

from common.config import LearnerConfig
from common.errors import StorageError
from learner.algorithm.base import Algorithm, PublishedVersion
from learner.ingest import Ingest
from learner.run.best import BestPolicy

_REMEMBERED_VERSIONS = 4096


class Publisher:
    """Sends policy versions to the actors, and knows since when each has been replaced.

    Args:
        algorithm: has the weights.
        best: keeps what is published until its evaluation has come.
        send: sends a version to the actors; must not wait for them.
        config: how often versions go out, and whether evaluation uses the moving average of the weights.
    """

    def __init__(
        self, algorithm: Algorithm, best: BestPolicy, send: Callable[[PublishedVersion], None], config: LearnerConfig
    ) -> None:
        self._algorithm = algorithm
        self._best = best
        self._send = send
        self._config = config
        self._published_at: OrderedDict[int, float] = OrderedDict()
        self._sent_at = float("-inf")
        # A version ought to go out. It waits while the last one has not been out for long enough, and when the disk
        # refused to note it.
        self._due = False

    def publish(self, ingest: Ingest, updates: int) -> None:
        """Send the newest policy under a new version number; not at all when the disk refuses to note that.

        Args:
            ingest: notes the number, so that no later process uses it again.
            updates: that the policy has had.
        """
        version = ingest.version + 1
        try:
            ingest.note_version(version)
        except StorageError:
            self._due = True
            return
        self._due = False
        self._sent_at = time.monotonic()
        averaged = self._algorithm.policy_weights(averaged=True) if self._config.average_decay else None
        published = PublishedVersion(version, updates, self._algorithm.policy_weights(averaged=False), averaged)
        acting = published.weights if averaged is None else averaged
        self._best.remember(version, updates, acting, ingest.versions_under_evaluation)
        self._published_at[version] = self._sent_at
        while len(self._published_at) > _REMEMBERED_VERSIONS:
            self._published_at.popitem(last=False)
        self._send(published)

    def note_update(self, updates: int) -> None:
        """Take notice of an update: every `learner.publish_every` a version is due."""
        self._due |= updates % self._config.publish_every == 0

    def publish_if_due(self, ingest: Ingest, updates: int, receivers: int) -> None:
        """Publish what is due, once so many receivers had time for the last version; see `publish`."""
        seconds = self._config.publish_seconds_per_actor * receivers
        if self._due and time.monotonic() - self._sent_at >= seconds:
            self.publish(ingest, updates)

    def superseded_for(self, version: int) -> float:
        """Seconds for which a policy version has not been the newest; 0 for the newest and for unknown ones."""
        at = self._published_at.get(version + 1)
        return 0.0 if at is None else time.monotonic() - at
