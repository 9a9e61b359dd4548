"""The parts of training behind the loop: each method is one stage that the loop names."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence

import numpy as np

from common.errors import StorageError
from learner.algorithm.base import Algorithm, NotFiniteError, Prepare, PublishedVersion
from learner.algorithm.batch import TransitionBatch
from learner.algorithm.initial_policy import initial_weights
from learner.checkpointing import Checkpointer
from learner.curve_recorder import LOG_EVERY, CurveRecorder
from learner.evaluations import Evaluations
from learner.ingest import Ingest
from learner.prefetch import Prefetch
from learner.publishing import Publisher
from learner.rate_limiter import RateLimiter
from learner.readiness import WAIT_SECONDS, Readiness
from learner.replay.buffer import ReplayBuffer
from learner.replay.draw import draw_batch
from learner.run.best import BestPolicy
from learner.run.cards import PolicyCards
from learner.run.checkpoints import CheckpointStore
from learner.run.disk import DiskWatch
from learner.run.episodes import EpisodeLog
from learner.run.evaluation import validation_of
from learner.run.event_file import mend_folder
from learner.run.files import DAMAGED
from learner.run.folder import RunFolder, has_begun
from learner.run.group_commit import GroupCommit
from learner.run.journal import Journal
from learner.run.mirror import Mirror
from learner.run.summary import RunSummary, write_summary
from learner.watch.writers import make_writers

logger = logging.getLogger(__name__)


class Trainer:
    """Holds what a run consists of, and offers the stages of the loop.

    Use `begin` for a new run or `resume` for an earlier one before anything else, and `close` at the end.

    Args:
        run: the run's folder.
        algorithm: the mathematics.
        publish: sends a policy version to the actors; must not wait for them.
        evaluators: hosts whose evaluators count besides those of `learner.evaluators`: those that the learner starts.
        prepare: draw and prepare the next batch by this in a thread of its own while the device computes; None for
            all in turn. Resuming then draws other batches than going on would have.
    """

    def __init__(
        self,
        run: RunFolder,
        algorithm: Algorithm,
        publish: Callable[[PublishedVersion], None],
        evaluators: Sequence[str] = (),
        *,
        prepare: Prepare | None = None,
    ) -> None:
        config = run.config
        self.run = run
        self.config = config
        self.algorithm = algorithm
        self._evaluators = tuple(evaluators)
        images, hints = config.network.reads_image, config.hinted
        self.replay = ReplayBuffer(config.replay.capacity, config.replay.max_bytes, images=images, hints=hints)
        self.limiter = RateLimiter(
            config.learner.updates_per_step, config.learner.ratio_tolerance, config.replay.min_steps
        )
        self.disk = DiskWatch(run.path)
        self.checkpoints = CheckpointStore(run.checkpoints, config.checkpoints.keep)
        self._journal = Journal(run.journal, disk=self.disk)
        self.commit = GroupCommit(self._journal, config.journal.sync_seconds)
        self._rng = np.random.default_rng([config.seed, 2])
        self._ahead = None if prepare is None else Prefetch(self.replay, config, prepare)
        self._cards = PolicyCards(config, self.limiter)
        self.best = BestPolicy(self.checkpoints, self._cards.describe, validation_of(config))
        self._publisher = Publisher(algorithm, self.best, publish, config.learner)
        self._checkpointer = Checkpointer(config, self.checkpoints, algorithm, self._rng, self._cards.describe)
        mirror = config.checkpoints.mirror
        self._mirror = None if mirror is None else Mirror(run.path, self.checkpoints, mirror)
        self._stop = threading.Event()
        self.readiness = Readiness(config, self.replay, self.limiter, self.disk, self._stop)
        self._evaluations = Evaluations(self.best)
        self.receivers = 0
        """Processes on the network that fetch each version."""
        self.ingest: Ingest
        self.recorder: CurveRecorder

    # --- beginning and end -------------------------------------------------------------------------------------

    def begin(self) -> None:
        """Begin a run: nothing learnt but what an initial policy knows, and a first checkpoint.

        What the journal holds counts, when the run was begun before and came to no checkpoint.

        Raises:
            CheckpointError: the initial policy cannot be read.
            StorageError: the disk refuses the run's files; it may refuse the checkpoint, which waits for room.
            WeightsError: it does not fit the configured network.
        """
        if (found := initial_weights(self.config)) is not None:
            weights, card = found
            self.algorithm.adopt(weights)
            logger.info("training continues from the policy of run %s, %d updates", card.run, card.updates)
        self._open_records(episodes_length=0, updates=0)
        self.recorder.write_text("config", f"```json\n{self.config.model_dump_json(indent=2)}\n```")
        if len(self._journal.segments()) > 1:
            self.ingest.rebuild(self.ingest.nothing_yet, updates=0)
        self.run.write_config()
        self._first_checkpoint()

    def resume(self) -> None:
        """Continue from the newest sound checkpoint and the journal; begin when there has never been a checkpoint.

        Raises:
            CheckpointError: when no checkpoint is usable, or the journal behind it is of another release.
            StorageError: the disk refuses what has to be written for that.
        """
        if not has_begun(self.run.path):
            logger.info("run %s has no checkpoint yet: starting over", self.config.name)
            self.begin()
            return
        checkpoint = self.checkpoints.load_newest()
        self._cards.earlier_seconds = self._checkpointer.restore(checkpoint, self._open_records)
        updates = self.limiter.updates
        self.run.write_config()
        self.run.note_code(updates)
        logger.info(
            "resumed run %s from checkpoint %s: %d updates, %d steps, %d episodes",
            self.config.name,
            checkpoint.name,
            updates,
            self.limiter.steps,
            self.ingest.episode_count,
        )

    def close(self) -> None:
        """Close all files; no checkpoint is made here."""
        if self._ahead is not None:
            self._ahead.close()
        if hasattr(self, "recorder"):
            self.recorder.close()
            self.ingest.episodes.close()
        self.commit.close()
        self._journal.close()
        if self._mirror is not None:
            self._mirror.close()

    def _open_records(self, episodes_length: int, updates: int) -> tuple[Ingest, CurveRecorder]:
        episodes = EpisodeLog(self.run.episodes, episodes_length, self.disk)
        self.ingest = Ingest(self.config, self.replay, self.limiter, self._journal, episodes, self._evaluators)
        mend_folder(self.run.tensorboard, self.run.path / DAMAGED)
        writers = make_writers(self.run.path, self.config)
        self.recorder = CurveRecorder(self.run.tensorboard, self.ingest, updates, self.disk, writers)
        return self.ingest, self.recorder

    # --- the stages of the loop --------------------------------------------------------------------------------

    @property
    def finished(self) -> bool:
        """Whether the run is complete or was told to stop."""
        return self._stop.is_set() or self.complete

    @property
    def complete(self) -> bool:
        """Whether all updates of the run are made."""
        return self.limiter.updates >= self.config.learner.total_updates

    def data_is_ready(self) -> bool:
        """Wait a moment for all that the next update needs; return whether it is there; see `Readiness`."""
        return self.readiness.wait(self.ingest)

    def sample(self) -> TransitionBatch:
        """Draw the batch of the next update, or take the one that was prepared during the last."""
        began = time.perf_counter()
        if self._ahead is not None:
            batch = self._ahead.next(self.limiter.updates)
        else:
            size = self.config.learner.batch_size
            batch = draw_batch(self.replay, self.config, size, self._rng, cloning=self.readiness.cloning)
        self.recorder.note("time/sample_ms", 1e3 * (time.perf_counter() - began))
        return batch

    def learn(self, batch: TransitionBatch) -> bool:
        """Make one update; return False when nothing could be learnt from the batch, which is set aside then.

        Raises:
            HDError: when that happens again and again; the weights are those before the first time.
        """
        began = time.perf_counter()
        try:
            figures = self.algorithm.update(batch)
        except NotFiniteError as error:
            self.ingest.quarantine.take(batch, error, self.limiter.updates + 1)
            return False
        self.ingest.quarantine.note_sound()
        self.limiter.note_update()
        self.recorder.note_update(figures)
        self.recorder.note("time/update_ms", 1e3 * (time.perf_counter() - began))
        return True

    def publish(self) -> None:
        """Send the newest policy to the actors under a new version number; later, when the disk refuses to note it."""
        self._publisher.publish(self.ingest, self.limiter.updates)

    def publish_if_due(self) -> None:
        """Publish every `learner.publish_every` updates, once the actors had time for the last version, and the end."""
        self._publisher.note_update(self.limiter.updates)
        if self.complete:
            self.publish()
        else:
            self._publish_due()

    def _publish_due(self) -> None:
        self._publisher.publish_if_due(self.ingest, self.limiter.updates, self.receivers)

    def record_if_due(self) -> None:
        """Write a point of each curve every few updates."""
        if self.limiter.updates % LOG_EVERY == 0 or self.complete:
            self.recorder.write()

    def serve(self) -> None:
        """Do what has become due besides updates: the best policy, a checkpoint by the clock or by command.

        What the disk refuses stays due until there is room.
        """
        self._evaluations.collect(self.ingest)
        if self.disk.holds():
            return
        try:
            self._evaluations.consider(self.recorder)
            self._publish_due()
            if self._checkpointer.schedule.is_due(self.limiter.updates, self.limiter.steps):
                self.checkpoint()
        except StorageError as error:
            self.disk.refused(error)

    def evaluation_is_ready(self) -> bool:
        """Wait a moment for the evaluation of the final policy; return True once there is nothing to wait for.

        That is: it has come, no evaluator has said anything for a while, or the run was told to stop.
        """
        # Not the event's own wait: its lock is no place for a signal handler that sets it.
        time.sleep(WAIT_SECONDS)
        return self._stop.is_set() or self._evaluations.over(self.ingest)

    def checkpoint(self) -> str:
        """Write a checkpoint, drop what it makes superfluous and return its name.

        Raises:
            StorageError: when the disk refuses it; the one before stays, and the journal with it.
        """
        name = self._checkpointer.save(self.ingest, self.recorder)
        summary = self.summary()
        write_summary(self.run.path, summary)
        if self._mirror is not None:
            self._mirror.note()
        self.recorder.write_summary(summary.flat())
        return name

    def finish(self) -> None:
        """Leave the checkpoint of the end; whoever asks for one from now on has it.

        Raises:
            StorageError: as `checkpoint`.
        """
        covered = False
        try:
            self.checkpoint()
            covered = True
        finally:
            self._checkpointer.schedule.end(covered)

    # --- commands from other threads ---------------------------------------------------------------------------

    def stop(self) -> None:
        """Let the loop end after the update that it is in."""
        self._stop.set()
        self._wake()

    @property
    def stopping(self) -> bool:
        """Whether the loop was told to end."""
        return self._stop.is_set()

    def pause(self) -> None:
        """Make no more updates, and let the actors wait, until `unpause`."""
        self.limiter.paused = True

    def unpause(self) -> None:
        """Go on after `pause`."""
        self.limiter.paused = False
        self._wake()

    def request_checkpoint(self, timeout: float) -> bool:
        """Let the loop make a checkpoint now; return whether it was done in time."""
        return self._checkpointer.schedule.request_and_wait(timeout)

    # --- what others see ---------------------------------------------------------------------------------------

    @property
    def state(self) -> str:
        """What the learner does now, one word."""
        if self.complete:
            return "complete"
        if self.stopping:
            return "stopping"
        if self.disk.full:
            return "disk full"
        if self.readiness.held:
            return "held"
        if self.limiter.paused:
            return "paused"
        if self.readiness.waiting:
            return "waiting" if self.limiter.updates else "collecting"
        return "cloning" if self.readiness.cloning else "training"

    @property
    def uptime(self) -> float:
        """Seconds since this process began."""
        return self._cards.uptime

    @property
    def next_checkpoint(self) -> float:
        """Seconds until the next checkpoint."""
        return self._checkpointer.schedule.seconds_left

    def superseded_for(self, version: int) -> float:
        """Seconds for which a policy version has not been the newest; 0 for the newest and for unknown ones."""
        return self._publisher.superseded_for(version)

    def summary(self) -> RunSummary:
        """Describe the run for a table of runs."""
        return RunSummary(
            name=self.config.name,
            state=self.state,
            task=self.config.task_name,
            algorithm=self.config.algorithm,
            updates=self.limiter.updates,
            total_updates=self.config.learner.total_updates,
            steps=self.limiter.steps,
            episodes=self.ingest.episode_count,
            hours=round(self._cards.seconds / 3600.0, 3),
            best_version=self.best.version,
            best=self.best.figures,
            seed=self.config.seed,
            commit=self._cards.commit,
            written=time.strftime("%Y-%m-%dT%H:%M:%S%z"),
        )

    # --- parts -------------------------------------------------------------------------------------------------

    def _first_checkpoint(self) -> None:
        while True:
            try:
                self.checkpoint()
                return
            except StorageError as error:
                self.disk.refused(error)
            while self.readiness.wait_for_room():
                pass

    def _wake(self) -> None:
        if hasattr(self, "ingest"):
            self.ingest.wake()
