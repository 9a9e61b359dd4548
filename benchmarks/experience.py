"""Real transitions for the parts that measure learning: episodes of a random policy in generated worlds."""

from __future__ import annotations

import numpy as np

from actors.collector import Collector
from common.config import NetworkConfig, RunConfig
from common.messages.experience import Chunk, Delivery, EpisodeReport
from learner.algorithm.batch import TransitionBatch
from learner.replay.buffer import ReplayBuffer

EPISODES = 12


def real_transitions(count: int, episodes: int = EPISODES) -> TransitionBatch:
    """Draw ``count`` labelled transitions from exploration episodes in ``generator:rooms``; the same at every call."""
    config = RunConfig.model_validate(
        {
            "maps": {"train": ["generator:rooms"]},
            "simulator": {"name": "grid"},
            "network": NetworkConfig(width=16, heads=2, layers=1).model_dump(),
            "reward": {"kind": "potential"},
            "cloning": {"updates": 1, "expert_episodes": 1.0},
        }
    )
    replay = ReplayBuffer(capacity=20_000, max_bytes=200_000_000)
    sequence = 0

    def store(body: Chunk | EpisodeReport) -> None:
        nonlocal sequence
        replay.add(Delivery("bench", 0, sequence, body))
        sequence += 1

    collector = Collector(config, [0], store)
    try:
        for _ in range(episodes):
            collector.collect()
    finally:
        collector.close()
    return replay.sample(count, np.random.default_rng(0), labelled=True)
