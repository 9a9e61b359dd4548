"""Random episodes as actors deliver them, for the tests of the learner."""

from __future__ import annotations

import numpy as np

from common.messages.experience import Chunk, Delivery, End, EpisodeReport, ExpertLabels
from common.observations.observation import Observation, ObservationBatch
from tests.observations import TARGETS, random_observation

POOL_SIZE = 60


def observation_pool(
    seed: int = 0, viewpoints: tuple[int, int] = (2, 40), size: int = POOL_SIZE, *, image: bool = False
) -> list[Observation]:
    """Random observations of all kinds to build episodes from; making them is the slow part."""
    rng = np.random.default_rng(seed)
    return [
        random_observation(
            rng, int(rng.integers(viewpoints[0], viewpoints[1] + 1)), TARGETS[rng.integers(len(TARGETS))], image=image
        )
        for _ in range(size)
    ]


def episode_chunks(
    rng: np.random.Generator,
    pool: list[Observation],
    steps: int,
    chunk_steps: int,
    end: End,
    labelled: bool = False,
    episode: int = 0,
) -> list[Chunk]:
    """Cut one random episode into chunks; step t carries reward episode * 1000 + t, by which tests know it again."""
    observations = [pool[rng.integers(len(pool))] for _ in range(steps + (end is not End.NONE))]
    chunks = []
    for first in range(0, steps, chunk_steps):
        last = min(first + chunk_steps, steps)
        final = last == steps
        held = observations[first : last + (final and end is not End.NONE)]
        acting = held[: last - first]
        labels = None
        if labelled:
            costs = [rng.uniform(0, 30, len(o.waypoint_nodes())).astype(np.float32) for o in acting]
            labels = ExpertLabels(
                cost=np.concatenate(costs),
                beacon=np.array([rng.choice(o.beacon_nodes()) for o in acting], dtype=np.int32),
                remaining=(10.0 * (steps - np.arange(first, last))).astype(np.float32),
                unseen=(100.0 * (steps - np.arange(first, last))).astype(np.float32),
            )
        chunks.append(
            Chunk(
                episode=episode,
                first_step=first,
                observations=ObservationBatch.stack(held),
                beacons=np.array([rng.choice(o.beacon_nodes()) for o in acting], dtype=np.int32),
                waypoints=np.array([rng.choice(o.waypoint_nodes()) for o in acting], dtype=np.int32),
                rewards=(episode * 1000 + np.arange(first, last)).astype(np.float32),
                versions=np.full(last - first, 3, dtype=np.int64),
                probabilities=rng.uniform(0.1, 1.0, last - first).astype(np.float32),
                labels=labels,
                end=end if final else End.NONE,
                family=episode % 3,
            )
        )
    return chunks


def deliver(bodies: list[Chunk | EpisodeReport] | list[Chunk], actor: str = "desk-0") -> list[Delivery]:
    """Number bodies as one incarnation of an actor does."""
    return [Delivery(actor=actor, incarnation=7, sequence=i, body=body) for i, body in enumerate(bodies)]


def episode_report(role: str = "train", version: int = 1, **changes: object) -> EpisodeReport:
    """A plausible report of a finished episode."""
    values: dict[str, object] = {
        "task": "exploration",
        "map_name": "rooms-1",
        "simulator": "grid",
        "role": role,
        "driver": "policy",
        "version": version,
        "steps": 20,
        "distance": 250.0,
        "success": True,
        "explored": 0.99,
        "reward": 12.0,
        "collisions": 0,
        "duration": 1.5,
    }
    return EpisodeReport(**(values | changes))  # type: ignore[arg-type]
