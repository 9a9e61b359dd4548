"""A learner that shares each update with other processes; to the training loop it is one algorithm like any other."""

from __future__ import annotations

import logging
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch

from common.config import RunConfig
from common.errors import ConfigError
from common.system.closing import Closing
from learner.algorithm.base import Algorithm, NotFiniteError, PolicyArrays, RanksError
from learner.algorithm.batch import TransitionBatch
from learner.algorithm.factory import make_learner
from learner.algorithm.finiteness import not_finite
from learner.algorithm.policy_learner import PolicyLearner
from learner.ranks.group import Group, rank_device
from learner.ranks.helper_process import HelperProcess
from learner.ranks.messages import batch_fields, frame, state_fields
from learner.ranks.shards import split

logger = logging.getLogger(__name__)

NOTICE_SECONDS = 0.5
MAX_PAUSE = 60.0
"""Seconds until a helper that ends again and again is started once more, at most."""
STEADY_SECONDS = 60.0
"""A helper that has lived for so long is started again at once."""


class _Place:
    """A rank other than 0: the process that fills it, and when the next may."""

    def __init__(self, number: int, device: torch.device) -> None:
        self.number = number
        self.device = device
        self.process: HelperProcess | None = None
        self.began = 0.0
        self.pause = 0.0


class Team(Closing):
    """Rank 0 with its helpers: every update is shared among those that are there.

    N ranks make the weights that one makes (`learner.algorithm.whole`), so a helper may go and come at any time: the
    update that it was lost in is made again by those that are left, another process takes its place, and joins with the
    weights and the optimisers' state of rank 0. Until then the run continues, more slowly.

    Args:
        config: of the run.
        learner: of rank 0.
        devices: of all ranks, that of rank 0 first.
        threads: of the numerical libraries in each helper.
    """

    def __init__(self, config: RunConfig, learner: PolicyLearner, devices: list[torch.device], threads: int) -> None:
        self._config = config
        self._learner = learner
        self._threads = threads
        self._places = [_Place(number, device) for number, device in enumerate(devices) if number]
        self._members: list[_Place] = []
        self._group: Group | None = None
        self._behind = True
        """Whether the helpers lack what rank 0 has learnt."""
        self._folder = tempfile.TemporaryDirectory(prefix="hd-ranks-")
        self._groups = 0
        self._muster()

    @property
    def device(self) -> torch.device:
        """Where rank 0 computes."""
        return self._learner.device

    @property
    def ranks(self) -> int:
        """Number of processes that share the next update, rank 0 among them."""
        return 1 + len(self._members)

    @property
    def helpers(self) -> list[int]:
        """Process numbers of the helpers."""
        return [place.process.pid for place in self._places if place.process is not None]

    def update(self, batch: TransitionBatch) -> dict[str, float]:
        """Learn from one batch; see `Algorithm.update`."""
        while True:
            self._muster()
            ranks = self.ranks
            try:
                figures = self._share(batch)
                break
            except RanksError as error:
                logger.warning("update %d is made again: %s", self._learner.updates + 1, error)
                self._disband()
        if bad := not_finite(figures):
            raise NotFiniteError(bad, self._learner.culprits(batch))
        figures["ranks/sharing"] = float(ranks)
        return figures

    def adopt(self, weights: PolicyArrays) -> None:
        """Begin with these policy weights; see `Algorithm.adopt`."""
        self._learner.adopt(weights)
        self._behind = True

    def state(self) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
        """Return everything that resuming needs, with any number of ranks; see `Algorithm.state`."""
        return self._learner.state()

    def restore(self, tensors: dict[str, torch.Tensor], values: dict[str, Any]) -> None:
        """Take over what `state` returned, of any number of ranks."""
        self._learner.restore(tensors, values)
        self._behind = True

    def policy_weights(self, averaged: bool) -> PolicyArrays:
        """Return the policy's weights, or their moving average."""
        return self._learner.policy_weights(averaged)

    def close(self) -> None:
        """End all helpers; safe to call twice."""
        self._leave()
        for place in self._places:
            if place.process is not None:
                place.process.close()
                place.process = None
        self._folder.cleanup()

    def _share(self, batch: TransitionBatch) -> dict[str, float]:
        """Make one update with the members of the group."""
        if self._group is None or len(batch) < self._group.size:
            self._behind = True
            self._learner.ranks = None
            return self._learner.step(batch)
        if self._behind:
            self._tell(frame("state", **state_fields(*self._learner.state())))
            self._behind = False
        own, *others = split(batch, self._group.size)
        for place, part in zip(self._members, others, strict=True):
            assert place.process is not None
            place.process.send(frame("update", batch=batch_fields(part)))
        self._learner.ranks = self._group
        return self._learner.step(own)

    def _tell(self, message: bytes) -> None:
        for place in self._members:
            assert place.process is not None
            place.process.send(message)

    def _muster(self) -> None:
        """Start helpers where there are none, and make a new group when a member is gone or another is ready."""
        for place in self._places:
            self._fill(place)
        ready = [place for place in self._places if place.process is not None and place.process.ready]
        if ready != self._members:
            self._leave()
            try:
                self._join(ready)
            except RanksError as error:
                logger.warning("%s", error)
                self._disband()

    def _fill(self, place: _Place) -> None:
        """Start a process where there is none; one that ends soon and often is started ever more seldom."""
        now = time.monotonic()
        if place.process is not None and not place.process.alive:
            logger.warning("learner rank %d (process %d) has ended", place.number, place.process.pid)
            place.process.close()
            place.process = None
            place.pause = 0.0 if now - place.began > STEADY_SECONDS else min(2.0 * place.pause + 1.0, MAX_PAUSE)
        if place.process is None and now >= place.began + place.pause:
            place.began = now
            place.process = HelperProcess(place.number, self._config, place.device, self._threads)
            logger.info("started learner rank %d (process %d)", place.number, place.process.pid)

    def _join(self, places: list[_Place]) -> None:
        """Make the group of rank 0 and these."""
        if not places:
            return
        self._groups += 1
        meeting_place = Path(self._folder.name) / f"group-{self._groups}"
        self._members = places
        self._behind = True
        size = len(places) + 1
        for rank, place in enumerate(places, start=1):
            assert place.process is not None
            place.process.send(frame("join", rank=rank, size=size, meeting_place=str(meeting_place)))
        self._group = Group(0, size, meeting_place, self._learner.device)
        logger.info("%d learner processes share each update", size)

    def _leave(self) -> None:
        """Give up the group; its other members notice, and wait for the next."""
        group, self._group = self._group, None
        self._learner.ranks = None
        self._members = []
        if group is not None:
            group.close()

    def _disband(self) -> None:
        """Give up the group after a member was lost; when none has ended, one is silent, and all are started anew."""
        members = [place.process for place in self._members if place.process is not None]
        self._leave()
        end = time.monotonic() + NOTICE_SECONDS
        while all(process.alive for process in members) and time.monotonic() < end:
            time.sleep(0.01)
        if all(process.alive for process in members):
            for process in members:
                process.kill()


@contextmanager
def open_learner(config: RunConfig, device: torch.device, ranks: int, threads: int) -> Iterator[Algorithm]:
    """Make the algorithm of a run for so many processes, and end them with the `with`.

    Args:
        config: of the run.
        device: of rank 0; the others use the CPU as well, or a CUDA device each.
        ranks: number of processes, this one among them.
        threads: of the numerical libraries in each of the others.

    Raises:
        ConfigError: a batch has fewer transitions than there are ranks, or there are not as many CUDA devices.
    """
    if ranks > config.learner.batch_size:
        raise ConfigError(
            f"{ranks} learners cannot share batches of {config.learner.batch_size}: use fewer, or raise "
            "learner.batch_size"
        )
    devices = [rank_device(device, rank, ranks) for rank in range(ranks)]
    learner = make_learner(config, devices[0])
    if ranks == 1:
        yield learner
        return
    with Team(config, learner, devices, threads) as team:
        yield team
