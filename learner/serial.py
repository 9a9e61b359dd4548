"""Serial mode: the learner and one actor take turns in one process, without a network.

The same code as in a distributed run, so a debugger sees all of it and nothing depends on timing: the same seed gives
the same weights. This is the one module of `learner` that knows `actors`.
"""

from __future__ import annotations

import contextlib
import logging

import torch
from rich.console import Console

from actors.collector import Collector
from actors.launching import compile_kernels
from common.config import RunConfig
from common.errors import StorageError
from common.messages.experience import Chunk, Delivery, EpisodeReport
from common.system.kernel_folders import is_prepared, note_prepared
from common.system.runtime import limit_threads
from common.system.signals import stopping_signals
from learner.algorithm.base import Algorithm, PublishedVersion
from learner.algorithm.device import choose_device
from learner.algorithm.factory import make_learner
from learner.loop import train
from learner.report import Reporter
from learner.run.folder import RunFolder
from learner.trainer import Trainer
from learner.warmup import warm_up
from learner.watch.view import View

logger = logging.getLogger(__name__)

ACTOR = "serial"


class SerialTrainer(Trainer):
    """A trainer that collects its own experience whenever the declared ratio asks for more."""

    def __init__(self, run: RunFolder, algorithm: Algorithm) -> None:
        super().__init__(run, algorithm, self._load)
        self._collector: Collector | None = None
        self._version: PublishedVersion | None = None
        self._incarnation = 0
        self._sequence = 0

    def collect_here(self) -> None:
        """Make the actor; call it after `begin` or `resume`.

        The steps behind it tell a resumed actor from the one before it: other worlds, other sequence numbers.
        """
        self._incarnation = self.limiter.steps
        self._collector = Collector(self.config, [self.config.seed, self._incarnation], self._deliver)

    def data_is_ready(self) -> bool:
        """Run episodes until the ratio allows the next update; return whether it does."""
        assert self._collector is not None, "call collect_here first"
        if self.readiness.wait_for_room():
            return False
        while not (ready := self.readiness.may_learn()) and not self.finished:
            if self._version is not None:
                version, self._version = self._version, None
                self._collector.load(version.weights, version.version, version.updates)
            self._collector.collect(lambda: not self.stopping)
        return ready

    def close(self) -> None:
        """Close the simulator and all files."""
        if self._collector is not None:
            self._collector.close()
        super().close()

    def _load(self, version: PublishedVersion) -> None:
        self._version = version

    def _deliver(self, body: Chunk | EpisodeReport) -> None:
        delivery = Delivery(ACTOR, self._incarnation, self._sequence, body)
        self._sequence += 1
        while not self.stopping:
            try:
                self.ingest.store(delivery)
                return
            except StorageError:
                while self.readiness.wait_for_room() and not self.stopping:
                    pass


def run_serial(run: RunFolder, console: Console, *, resume: bool) -> None:
    """Train the run in ``run`` in this process until it is complete or told to stop.

    Args:
        run: the run's folder.
        console: shared by log and view.
        resume: continue from its newest checkpoint.

    Raises:
        HDError: when a map or a simulator cannot be used, the run cannot be continued, or training diverges.
    """
    config = run.config
    limit_threads(config.learner.threads)
    with contextlib.ExitStack() as stack:
        device = choose_device(config.learner.device)
        _compile(config, device)
        algorithm = make_learner(config, device)
        trainer = SerialTrainer(run, algorithm)
        stack.callback(trainer.close)
        if resume:
            trainer.resume()
        else:
            trainer.begin()
        trainer.collect_here()
        reporter = Reporter(trainer, str(algorithm.device))
        stack.enter_context(View(reporter.status, console))
        with stopping_signals(trainer.stop, lambda: trainer.stopping):
            train(trainer)
        words = "is complete" if trainer.complete else "was stopped"
        logger.info("run %s %s after %d updates", config.name, words, trainer.limiter.updates)


def _compile(config: RunConfig, device: torch.device) -> None:
    """Compile all kernels, unless that was done before: a signal breaks this off, while training would end its step.

    What `learner.compile` compiles, each process makes or reads anew.
    """
    network = config.network.model_dump_json()
    compile_kernels(network)
    use = f"serial {config.algorithm} {device.type} {network}"
    if config.learner.compile or not is_prepared("learner", use):
        warm_up(config, device)
        note_prepared("learner", use)
