"""Compute what a run of 10, 1,000 and 100,000 actors needs, from costs that were measured on one machine.

`python -m benchmarks.scale` prints the tables of docs/scale.md. Nothing is measured here: each cost names where it was.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from common.bus.session import MAX_SESSIONS
from common.config import RunConfig

ACTORS = (10, 1_000, 100_000)


@dataclass(frozen=True, slots=True)
class Costs:
    """Measured costs; the text of a field is where it comes from."""

    actor_steps_per_second: float = 93.0
    """one core, kinematic PyBullet, the paper's network ([speed](speed.md))"""
    actor_megabytes: float = 337.0
    """resident, kinematic PyBullet ([speed](speed.md))"""
    chunk_kilobytes: float = 69.0
    """a chunk of 16 steps ([speed](speed.md))"""
    chunk_milliseconds: float = 0.55
    """of the learner's processor, receiving to acknowledging: 0.5 to 0.6"""
    weights_megabytes: float = 0.7
    """one version of a policy of width 64"""
    weights_milliseconds: float = 0.9
    """of the learner's processor, for each version and receiver"""
    update_seconds: float = 1.0 / 2.9
    """one core: soft actor-critic at batch 64, width 64, bf16, reduced graph ([speed](speed.md))"""
    cores_for_io: float = 1.0
    """a learner receives and sends in one Python process"""


@dataclass(frozen=True, slots=True)
class Needs:
    """What a run needs; every figure of the learner is of all learners together.

    Attributes:
        actors: number.
        machines: with 64 cores for actors.
        steps: collected a second.
        chunks: messages with experience a second.
        megabits_in: of experience to the learner.
        ingest_cores: that take the messages in.
        journal_gigabytes: written an hour.
        replay_seconds: for which a step stays in the replay buffer.
        update_cores: that keep the declared ratio of updates to steps.
        publish_seconds: between two versions, so that sending them takes a tenth of one core.
        megabits_out: of weights from the learner, by then.
        routers: with as many sessions as one takes.
        bottleneck: what limits first when the learner is one process with one core for its updates.
    """

    actors: int
    machines: int
    steps: float
    chunks: float
    megabits_in: float
    ingest_cores: float
    journal_gigabytes: float
    replay_seconds: float
    update_cores: float
    publish_seconds: float
    megabits_out: float
    routers: int
    bottleneck: str


def needs(actors: int, costs: Costs, config: RunConfig) -> Needs:
    """Compute the needs of so many actors at full speed."""
    steps = actors * costs.actor_steps_per_second
    chunks = steps / config.actor.chunk_steps
    ingest = chunks * costs.chunk_milliseconds / 1e3
    updates = steps * config.learner.updates_per_step * costs.update_seconds
    sending = actors * costs.weights_milliseconds / 1e3
    publish = sending / (0.1 * costs.cores_for_io)
    loads = {
        "updates: more ranks or GPUs, or a lower ratio": updates,
        "taking messages in: several learner processes for it": ingest / costs.cores_for_io,
        "sessions: routers": actors / MAX_SESSIONS,
    }
    worst = max(loads, key=loads.__getitem__)
    return Needs(
        actors=actors,
        machines=math.ceil(actors / 64),
        steps=steps,
        chunks=chunks,
        megabits_in=chunks * costs.chunk_kilobytes * 8e-3,
        ingest_cores=ingest,
        journal_gigabytes=chunks * costs.chunk_kilobytes * 3600 / 1e6,
        replay_seconds=config.replay.capacity / steps,
        update_cores=updates,
        publish_seconds=publish,
        megabits_out=actors * costs.weights_megabytes * 8 / publish,
        routers=math.ceil(actors / MAX_SESSIONS) if actors > MAX_SESSIONS else 0,
        bottleneck=f"{worst} ({loads[worst]:,.0f} x)" if loads[worst] > 1.0 else "none",
    )


def largest(costs: Costs, config: RunConfig, update_cores: float) -> float:
    """Return how many actors at full speed a learner serves with so many cores' worth of updates."""
    by_updates = update_cores / (costs.actor_steps_per_second * config.learner.updates_per_step * costs.update_seconds)
    per_actor = costs.actor_steps_per_second / config.actor.chunk_steps * costs.chunk_milliseconds / 1e3
    return min(by_updates, costs.cores_for_io / per_actor, MAX_SESSIONS)


def page() -> str:
    """Return the tables as Markdown."""
    costs, config = Costs(), RunConfig()
    found = [needs(actors, costs, config) for actors in ACTORS]
    rows = [
        ("machines of 64 cores for actors", [f"{n.machines:,}" for n in found]),
        ("memory of actors, GB", [f"{n.actors * costs.actor_megabytes / 1e3:,.0f}" for n in found]),
        ("steps/s", [f"{n.steps:,.0f}" for n in found]),
        ("messages/s", [f"{n.chunks:,.0f}" for n in found]),
        ("experience to the learner, Mbit/s", [f"{n.megabits_in:,.0f}" for n in found]),
        ("cores that take it in", [f"{n.ingest_cores:,.2f}" for n in found]),
        ("journal, GB/h", [f"{n.journal_gigabytes:,.0f}" for n in found]),
        (f"seconds in a buffer of {config.replay.capacity:,}", [f"{n.replay_seconds:,.2f}" for n in found]),
        (f"cores for {config.learner.updates_per_step} updates/step", [f"{n.update_cores:,.0f}" for n in found]),
        ("seconds between versions, for a tenth of a core", [f"{n.publish_seconds:,.1f}" for n in found]),
        ("weights from the learner then, Mbit/s", [f"{n.megabits_out:,.0f}" for n in found]),
        ("routers", [f"{n.routers:,}" for n in found]),
        ("first limit of one learner with one core", [n.bottleneck for n in found]),
    ]
    head = " | ".join(f"{n.actors:,} actors" for n in found)
    lines = [f"| | {head} |", "| --- |" + " ---: |" * len(found)]
    lines += [f"| {what} | {' | '.join(values)} |" for what, values in rows]
    lines += ["", "| cores' worth of updates | actors at full speed |", "| ---: | ---: |"]
    lines += [f"| {cores:,} | {largest(costs, config, cores):,.1f} |" for cores in (1, 8, 100, 1_000)]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(page(), end="")
