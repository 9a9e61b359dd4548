"""What processes tell about themselves once a second; loss is harmless."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ActorStats:
    """How an actor (or an evaluator) is doing.

    Attributes:
        actor: name of the actor.
        host: name of its machine.
        pid: process number.
        steps: decisions since its start.
        episodes: finished episodes since its start.
        steps_per_second: decisions per wall second of late.
        version: policy version in use, -1 before the first.
        version_age: seconds since that version arrived.
        buffered: messages that wait for an acknowledgement.
        state: what it does now, one line.
        restarts: how often it was started again after it had ended by itself.
        last_error: why it ended the last time, one line; empty where it never did.
    """

    actor: str
    host: str
    pid: int
    steps: int
    episodes: int
    steps_per_second: float
    version: int
    version_age: float
    buffered: int
    state: str
    restarts: int = 0
    last_error: str = ""


@dataclass(frozen=True, slots=True)
class LearnerStats:
    """How the learner is doing.

    Attributes:
        host: name of its machine.
        pid: process number.
        steps: decisions stored since the run began.
        episodes: finished episodes reported since the run began.
        updates: gradient updates since the run began.
        version: newest published policy version, -1 before the first.
        steps_per_second: decisions stored per wall second of late.
        updates_per_second: updates per wall second of late.
        replay: transitions in the replay buffer.
        state: what it does now, one line.
    """

    host: str
    pid: int
    steps: int
    episodes: int
    updates: int
    version: int
    steps_per_second: float
    updates_per_second: float
    replay: int
    state: str
