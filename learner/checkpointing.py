"""The checkpoints of training: when the next one is due, and what it holds."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import asdict

import numpy as np
import torch

from common.config import RunConfig
from common.errors import CheckpointError
from common.policies.policy_file import PolicyCard
from learner.algorithm.base import Algorithm
from learner.curve_recorder import CurveRecorder
from learner.ingest import Ingest
from learner.run.checkpoints import EXPORT_PREFIX, Checkpoint, CheckpointStore

logger = logging.getLogger(__name__)


class CheckpointSchedule:
    """When a checkpoint is due: by the clock when there is something new, or by command at once; safe between threads.

    Args:
        every_seconds: between two checkpoints.
    """

    def __init__(self, every_seconds: float) -> None:
        self._every_seconds = every_seconds
        self._due_at = 0.0
        self._covered = (-1, -1)
        self._wanted = threading.Event()
        self._done = threading.Condition()
        self._made = 0
        self._ended: bool | None = None

    def restart(self) -> None:
        """Count the seconds to the next checkpoint from now on."""
        self._due_at = time.monotonic() + self._every_seconds

    def is_due(self, updates: int, steps: int) -> bool:
        """Whether a checkpoint should be made, now that there are so many updates and collected steps."""
        return self._wanted.is_set() or (time.monotonic() >= self._due_at and (updates, steps) != self._covered)

    def note_written(self, updates: int, steps: int) -> None:
        """Take note that a checkpoint of so many updates and collected steps lies on the disk."""
        self._covered = (updates, steps)
        self._wanted.clear()

    def note_done(self) -> None:
        """Release those who wait for the checkpoint that they asked for."""
        with self._done:
            self._made += 1
            self._done.notify_all()

    def end(self, covered: bool) -> None:
        """Release everybody who waits, now and later: the loop makes no more checkpoints.

        Args:
            covered: whether the last one holds all that there is.
        """
        with self._done:
            self._ended = covered
            self._done.notify_all()

    def request(self) -> None:
        """Make a checkpoint due at once."""
        self._wanted.set()

    def request_and_wait(self, timeout: float) -> bool:
        """Make a checkpoint due at once, and wait for it; return whether it was made within so many seconds.

        At the end of a run nobody waits: its last checkpoint holds everything, or the disk refused it.
        """
        with self._done:
            before = self._made
            self.request()
            told = self._done.wait_for(lambda: self._made > before or self._ended is not None, timeout)
            return told and (self._made > before or self._ended is True)

    @property
    def seconds_left(self) -> float:
        """Seconds until the next checkpoint by the clock."""
        return max(0.0, self._due_at - time.monotonic())


class Checkpointer:
    """Writes all that training needs to continue into a checkpoint, and puts it back.

    Args:
        config: of the run.
        store: holds the checkpoints.
        algorithm: the mathematics.
        rng: draws the batches.
        describe: makes the card of a policy from its version and its updates.

    Attributes:
        schedule: when the next one is due.
    """

    def __init__(
        self,
        config: RunConfig,
        store: CheckpointStore,
        algorithm: Algorithm,
        rng: np.random.Generator,
        describe: Callable[[int, int], PolicyCard],
    ) -> None:
        self._config = config
        self._store = store
        self._algorithm = algorithm
        self._rng = rng
        self._describe = describe
        self.schedule = CheckpointSchedule(config.checkpoints.every_seconds)

    def save(self, ingest: Ingest, recorder: CurveRecorder) -> str:
        """Write a checkpoint, drop what it makes superfluous and return its name.

        Args:
            ingest: counts what has come.
            recorder: of the run's curves.

        Raises:
            StorageError: when the disk refuses it; the one before stays, and the journal with it.
        """
        began = time.monotonic()
        snapshot = ingest.snapshot()
        ingest.sync()
        updates = ingest.limiter.updates
        tensors, document = self._algorithm.state()
        for_export = self._algorithm.policy_weights(averaged=bool(self._config.learner.average_decay))
        card = asdict(self._describe(snapshot["version"], updates))
        folder = self._store.save(
            updates,
            {
                **tensors,
                **{EXPORT_PREFIX + name: torch.from_numpy(np.array(array)) for name, array in for_export.items()},
            },
            {
                "updates": updates,
                "algorithm": document,
                "rng": self._rng.bit_generator.state,
                "figures": recorder.state(),
                "ingest": snapshot,
                "policy": {name: value for name, value in card.items() if name not in ("network", "mapping")},
            },
        )
        self.schedule.note_written(updates, snapshot["steps"])
        ingest.forget_before(self._oldest_place())
        recorder.flush()
        self.schedule.restart()
        seconds = time.monotonic() - began
        recorder.note("time/checkpoint_ms", 1e3 * seconds)
        logger.info("checkpoint %s written in %.1f s", folder.name, seconds)
        self.schedule.note_done()
        return folder.name

    def restore(
        self, checkpoint: Checkpoint, open_records: Callable[[int, int], tuple[Ingest, CurveRecorder]]
    ) -> float:
        """Bring everything to where a checkpoint left it; return the seconds that the run had taken by then.

        Args:
            checkpoint: sound.
            open_records: makes what counts and what records, from the length of the log of episodes and the updates.

        Raises:
            CheckpointError: it does not fit, or the journal behind it is of another release.
        """
        try:
            document = checkpoint.document
            updates = int(document["updates"])
            seconds = float(document["policy"].get("wall_seconds", 0.0))
            snapshot = document["ingest"]
            tensors = {k: v for k, v in checkpoint.tensors.items() if not k.startswith(EXPORT_PREFIX)}
            self._algorithm.restore(tensors, document["algorithm"])
            self._rng.bit_generator.state = document["rng"]
            ingest, recorder = open_records(int(snapshot["episodes_length"]), updates)
            recorder.restore(document["figures"])
            ingest.rebuild(snapshot, updates)
        except (KeyError, TypeError, ValueError, RuntimeError) as error:
            raise CheckpointError(
                f"checkpoint {checkpoint.name} of {self._store.folder} does not fit this software or configuration: "
                f"{type(error).__name__}: {error}"
            ) from error
        self._store.set_aside_after(checkpoint.name)
        self.schedule.restart()
        return seconds

    def _oldest_place(self) -> int:
        """First journal segment that a kept checkpoint needs in order to count everything once."""
        places = []
        for name in self._store.names():
            try:
                places.append(int(self._store.document(name)["ingest"]["segment"]))
            except (OSError, ValueError, KeyError):
                logger.error("checkpoint %s has been damaged since it was written", self._store.folder / name)
        return min(places)
