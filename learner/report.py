"""Gathers the status of a running learner from its parts."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Mapping
from typing import Any

from common.bus.liveness import Process
from common.messages.stats import ActorStats, LearnerStats
from learner.run.episodes import GROUPS
from learner.trainer import Trainer
from learner.watch.actors import ActorRecord
from learner.watch.status import ActorStatus, LearnerStatus

FORGET_SECONDS = 600.0
"""An actor that is gone is still shown for this long."""


class Reporter:
    """Makes status records.

    Args:
        trainer: what is reported on.
        device: of the networks.
        endpoint: where the learner listens, empty in serial mode.
    """

    def __init__(self, trainer: Trainer, device: str, endpoint: str = "") -> None:
        self._trainer = trainer
        self._device = device
        self._endpoint = endpoint

    def status(
        self,
        present: frozenset[Process] = frozenset(),
        stats: Mapping[Process, tuple[Any, float]] | None = None,
        refused: int = 0,
    ) -> LearnerStatus:
        """Describe the learner at this moment.

        Args:
            present: processes on the bus, (role, name).
            stats: newest statistics of each process and their age in seconds.
            refused: invalid messages since the start.
        """
        trainer, ingest, limiter = self._trainer, self._trainer.ingest, self._trainer.limiter
        late = {group: means for group in GROUPS if (means := ingest.episodes.means(group)) is not None}
        return LearnerStatus(
            run=trainer.config.name,
            folder=str(trainer.run.path),
            endpoint=self._endpoint,
            state=trainer.state,
            device=self._device,
            uptime=trainer.uptime,
            steps=limiter.steps,
            episodes=ingest.episode_count,
            updates=limiter.updates,
            total_updates=trainer.config.learner.total_updates,
            steps_per_second=ingest.steps_rate.rate,
            updates_per_second=trainer.recorder.updates_rate.rate,
            version=ingest.version,
            replay=len(trainer.replay),
            replay_capacity=trainer.replay.capacity,
            replay_fill=trainer.replay.fill,
            replay_bytes=trainer.replay.bytes,
            ratio_declared=limiter.updates_per_step,
            ratio_actual=limiter.actual,
            ratio_lead=limiter.lead,
            hold=limiter.hold(),
            next_checkpoint=trainer.next_checkpoint,
            last_checkpoint=trainer.checkpoints.pointer("last") or "",
            best=trainer.best.version,
            best_figures=dict(trainer.best.figures),
            evaluated=-1 if trainer.recorder.evaluated is None else trainer.recorder.evaluated.version,
            evaluated_figures={} if trainer.recorder.evaluated is None else trainer.recorder.evaluated.figures,
            refused=refused,
            losses=dict(trainer.recorder.figures),
            late={str(group): means for group, means in late.items()},
            actors=self._actors(present, stats or {}),
        )

    def learner_stats(self, status: LearnerStatus) -> LearnerStats:
        """Shorten a status to what is sent around once a second."""
        return LearnerStats(
            host=platform.node(),
            pid=os.getpid(),
            steps=status.steps,
            episodes=status.episodes,
            updates=status.updates,
            version=status.version,
            steps_per_second=status.steps_per_second,
            updates_per_second=status.updates_per_second,
            replay=status.replay,
            state=status.state,
        )

    def _actors(self, present: frozenset[Process], stats: Mapping[Process, tuple[Any, float]]) -> list[ActorStatus]:
        records = dict(self._trainer.ingest.actors)
        roles = {name: role for role, name in (*stats, *present) if role in ("actor", "evaluator")}
        now = time.monotonic()
        actors = []
        for name in sorted({*records, *roles}):
            role = roles.get(name, "actor")
            alive = (role, name) in present
            told = stats.get((role, name))
            record = records.get(name)
            heard = now - record.arrived if record is not None else -1.0
            silence = min((age for age in (heard, told[1] if told else -1.0) if age >= 0), default=0.0)
            if alive or not self._endpoint or silence < FORGET_SECONDS:
                actors.append(self._actor(name, role, alive or not self._endpoint, record, told and told[0], heard))
        return actors

    def _actor(
        self, name: str, role: str, alive: bool, record: ActorRecord | None, told: ActorStats | None, heard: float
    ) -> ActorStatus:
        record = record or ActorRecord()
        version = record.version if told is None else told.version
        return ActorStatus(
            name=name,
            role=role,
            alive=alive,
            host="" if told is None else told.host,
            steps_per_second=0.0 if told is None else told.steps_per_second,
            steps=record.steps,
            episodes=record.episodes,
            version=version,
            lag=max(0, self._trainer.ingest.version - version) if version >= 0 else 0,
            lag_seconds=self._trainer.superseded_for(version),
            buffered=0 if told is None else told.buffered,
            silent=heard,
            state="" if told is None else told.state,
            restarts=0 if told is None else told.restarts,
            last_error="" if told is None else told.last_error,
        )
