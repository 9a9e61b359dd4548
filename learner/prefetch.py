"""The next batch, prepared while a device other than the host's processor computes an update."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from common.config import RunConfig
from common.system.closing import Closing
from learner.algorithm.base import Prepare
from learner.algorithm.batch import TransitionBatch
from learner.replay.buffer import ReplayBuffer
from learner.replay.draw import draw_batch


class Prefetch(Closing):
    """Draws a batch and builds its graphs one update ahead, in a thread of its own.

    On a GPU building graphs takes about as long as the rest of an update, and the kernels that build them let other
    threads run. A batch drawn ahead lacks the steps that arrive meanwhile.

    Args:
        replay: where batches are drawn from.
        config: of the run.
        prepare: builds their graphs.
    """

    def __init__(self, replay: ReplayBuffer, config: RunConfig, prepare: Prepare) -> None:
        self._replay = replay
        self._config = config
        self._prepare = prepare
        self._rng = np.random.default_rng()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="prefetch")
        self._ahead: tuple[bool, Future[TransitionBatch]] | None = None

    def next(self, updates: int) -> TransitionBatch:
        """Return the batch of the next update, and begin with the one after it.

        Args:
            updates: made so far.

        Raises:
            ValueError: the buffer holds nothing of the kind.
        """
        cloning = self._cloning(updates)
        ahead, self._ahead = self._ahead, None
        # At the end of imitation, when a batch was refused, the next one is of another kind than was expected.
        batch = ahead[1].result() if ahead is not None and ahead[0] == cloning else self._make(cloning)
        then = self._cloning(updates + 1)
        self._ahead = then, self._thread.submit(self._make, then)
        return batch

    def close(self) -> None:
        """Drop what is prepared and end the thread; safe to call twice."""
        self._thread.shutdown(cancel_futures=True)

    def _cloning(self, updates: int) -> bool:
        return updates < self._config.cloning.updates

    def _make(self, cloning: bool) -> TransitionBatch:
        size = self._config.learner.batch_size
        batch = draw_batch(self._replay, self._config, size, self._rng, cloning=cloning)
        return self._prepare(batch, self._rng, cloning=cloning)
