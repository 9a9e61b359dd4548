"""What a learner tells about itself: one record for the live view, the `status` command and the log."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import Any

from learner.run.episodes import EpisodeMeans

PAGE_BYTES = 150_000
"""Of the actors in one reply: with all else that stays well below the longest document that a message may hold."""


@dataclasses.dataclass(frozen=True, slots=True)
class ActorStatus:
    """One actor as the learner sees it.

    Attributes:
        name: of the actor.
        role: ``actor`` or ``evaluator``.
        alive: its presence is on the bus.
        host: its machine, empty before its first statistics.
        steps_per_second: decisions per second of late.
        steps: decisions that the learner stored from it since the learner started.
        episodes: finished episodes, likewise.
        version: policy version that it acts with, -1 while unknown.
        lag: versions that it is behind.
        lag_seconds: seconds since its version was no longer the newest, 0 when it acts with the newest.
        buffered: messages that wait for an acknowledgement.
        silent: seconds since its last delivery.
        state: what it says that it does.
        restarts: how often its supervisor started it again after it had ended by itself.
        last_error: why it ended the last time; empty where it never did.
    """

    name: str
    role: str
    alive: bool
    host: str
    steps_per_second: float
    steps: int
    episodes: int
    version: int
    lag: int
    lag_seconds: float
    buffered: int
    silent: float
    state: str
    restarts: int
    last_error: str


@dataclasses.dataclass(frozen=True, slots=True)
class LearnerStatus:
    """The learner at one moment.

    Attributes:
        run: name of the run.
        folder: of the run.
        endpoint: where it listens; empty in serial mode.
        state: ``collecting``, ``cloning``, ``training``, ``waiting``, ``paused``, ``disk full``, ``held``, ``stopping``
            or ``complete``.
        device: of the networks.
        uptime: seconds.
        steps: collected steps of the run.
        episodes: finished episodes of the run.
        updates: updates of the run.
        total_updates: updates after which the run is complete.
        steps_per_second: collected, of late.
        updates_per_second: of late.
        version: newest published policy version.
        replay: transitions in the replay buffer.
        replay_capacity: transitions that it holds at most.
        replay_fill: share of its limit in use, by number or by bytes.
        replay_bytes: memory in use.
        ratio_declared: updates per collected step.
        ratio_actual: likewise, so far.
        ratio_lead: collected steps that still wait for their updates.
        hold: seconds that actors are asked to pause.
        next_checkpoint: seconds until the next one.
        last_checkpoint: name of the newest, empty before the first.
        best: version of the best policy, -1 before the first complete evaluation.
        best_figures: its means over the validation worlds, see `Round.figures`.
        evaluated: version of the newest complete evaluation, -1 before the first of this process.
        evaluated_figures: its means over the validation worlds.
        refused: invalid messages since the start.
        losses: newest means of what an update reports.
        late: means over late episodes by group.
        actors: all known actors.
    """

    run: str
    folder: str
    endpoint: str
    state: str
    device: str
    uptime: float
    steps: int
    episodes: int
    updates: int
    total_updates: int
    steps_per_second: float
    updates_per_second: float
    version: int
    replay: int
    replay_capacity: int
    replay_fill: float
    replay_bytes: int
    ratio_declared: float
    ratio_actual: float
    ratio_lead: float
    hold: float
    next_checkpoint: float
    last_checkpoint: str
    best: int
    best_figures: dict[str, float]
    evaluated: int
    evaluated_figures: dict[str, float]
    refused: int
    losses: dict[str, float]
    late: dict[str, EpisodeMeans]
    actors: list[ActorStatus]

    def to_json(self) -> dict[str, Any]:
        """Return plain values."""
        return dataclasses.asdict(self)

    def page(self, after: str = "") -> dict[str, Any]:
        """Return plain values with as many actors as one reply holds.

        Args:
            after: only actors whose name comes after this one; `actors` is in the order of names.

        Returns:
            What `to_json` returns, and under ``next`` the name that the next page begins after; empty on the last one.
        """
        actors: list[dict[str, Any]] = []
        size, following = 0, ""
        for actor in self.actors:
            if actor.name <= after:
                continue
            values = dataclasses.asdict(actor)
            size += len(json.dumps(values))
            if actors and size > PAGE_BYTES:
                following = actors[-1]["name"]
                break
            actors.append(values)
        return {**dataclasses.asdict(dataclasses.replace(self, actors=[])), "actors": actors, "next": following}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> LearnerStatus:
        """Read what `to_json` or `page` wrote; raise TypeError or KeyError when something is missing or unknown."""
        late = {group: EpisodeMeans(**means) for group, means in values["late"].items()}
        actors = [ActorStatus(**actor) for actor in values["actors"]]
        plain = {name: value for name, value in values.items() if name != "next"}
        return cls(**{**plain, "late": late, "actors": actors})
