"""The replay buffer at the size of a long run: adds, samples and memory.

Run with ``python -m benchmarks.replay``.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from common.messages.experience import Chunk, Delivery, End
from common.messages.schema import decode, encode
from common.observations.observation import Observation, ObservationBatch
from learner.replay.buffer import ReplayBuffer
from tests.observations import random_observation

STEPS = 16
BATCH = 64


def deliveries(count: int, seed: int = 0) -> list[Delivery]:
    """Chunks of whole episodes with graphs of 185 viewpoints on average (90 to 280).

    A viewpoint has 12 neighbours on average, and every twentieth edge is bent.
    """
    rng = np.random.default_rng(seed)
    pool = [random_observation(rng, int(rng.integers(90, 281)), edge_share=0.52, bent_share=0.05) for _ in range(100)]
    made = []
    for number in range(count):
        episode, part = divmod(number, 4)
        end = End.TERMINAL if part == 3 else End.NONE
        held = [pool[rng.integers(len(pool))] for _ in range(STEPS + (end is not End.NONE))]
        made.append(Delivery("bench-0", 1, number, _chunk(rng, episode, part * STEPS, held, end)))
    return made


def _chunk(rng: np.random.Generator, episode: int, first: int, held: list[Observation], end: End) -> Chunk:
    acting = held[:STEPS]
    return Chunk(
        episode=episode,
        first_step=first,
        observations=ObservationBatch.stack(held),
        beacons=np.array([rng.choice(o.beacon_nodes()) for o in acting], dtype=np.int32),
        waypoints=np.array([rng.choice(o.waypoint_nodes()) for o in acting], dtype=np.int32),
        rewards=rng.normal(size=STEPS).astype(np.float32),
        versions=np.ones(STEPS, dtype=np.int64),
        probabilities=np.ones(STEPS, dtype=np.float32),
        labels=None,
        end=end,
    )


def run(capacity: int = 100_000) -> dict[str, float]:
    """Measure a buffer that is filled to its capacity and on until it turns over."""
    made = deliveries(64)
    warm_up = ReplayBuffer(capacity=1000, max_bytes=30_000_000)
    warm_up.add(made[0])
    warm_up.sample(BATCH, np.random.default_rng(0))
    before = _resident()
    replay = ReplayBuffer(capacity=capacity, max_bytes=500_000_000)
    chunks = int(1.3 * capacity / STEPS)
    began = time.perf_counter()
    for number in range(chunks):
        source = made[number % len(made)]
        body = source.body
        assert isinstance(body, Chunk)
        replay.add(Delivery("bench-0", 1 + number // len(made), source.sequence, body))
    seconds = time.perf_counter() - began
    rng = np.random.default_rng(1)
    sample = _best(lambda: replay.sample(BATCH, rng))
    data = encode(made[0])
    return {
        "transitions": float(len(replay)),
        "adds_per_second": chunks * STEPS / seconds,
        "sample_64_ms": 1e3 * sample,
        "bytes_per_observation": replay.bytes / replay.observations,
        "megabytes_counted": replay.bytes / 1e6,
        "megabytes_resident": (_resident() - before) / 1e6,
        "chunk_kilobytes": len(data) / 1e3,
        "chunk_decode_ms": 1e3 * _best(lambda: decode(data, Delivery)),
    }


def _best(function: Callable[[], object], repeats: int = 50) -> float:
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        function()
        times.append(time.perf_counter() - began)
    return min(times)


def _resident() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


if __name__ == "__main__":
    for name, value in run().items():
        print(f"{name:24s} {value:14.3f}")
