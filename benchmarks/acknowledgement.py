"""What acknowledging from the disk costs: ``python -m benchmarks.acknowledgement``.

Chunks of 16 steps go over loopback into the learner's ingest: journal, replay buffer, records. The journal lies in the
current folder, so run it on the disk in question.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import zenoh

from benchmarks.ingest import RUN, STEPS, chunk, deliver, free_port, latency
from common.bus.experience import ExperienceServer
from common.bus.keys import Keys
from common.bus.session import new_incarnation, open_client_session, open_learner_session
from common.config import BusConfig, RunConfig
from common.messages.experience import Delivery
from common.messages.schema import encode
from learner.ingest import Ingest
from learner.rate_limiter import RateLimiter
from learner.replay.buffer import ReplayBuffer
from learner.run.episodes import EpisodeLog
from learner.run.group_commit import GroupCommit
from learner.run.journal import Journal

MODES: dict[str, float | None] = {"memory": None, "disk_10_ms": 0.01, "disk_50_ms": 0.05, "disk_200_ms": 0.2}
"""Seconds between two syncs behind acknowledgements; None acknowledges from memory and syncs every 50 ms."""
PER_SECOND = 25.0
"""Chunks a second of the steady stream: what six kinematic actors with the network of `workstation` send."""


def run(chunks: int = 400, seconds: float = 12.0, processes: int = 4) -> dict[str, float]:
    """Measure rate and latency for each mode.

    Args:
        chunks: messages that each sending process delivers as fast as it can.
        seconds: of the steady stream; its first second is not counted.
        processes: that send.
    """
    results = {"sync_ms_p50": 1e3 * _sync_seconds()}
    for mode, interval in MODES.items():
        with _learner(interval) as config:
            alone = latency(config, repeats=min(100, 20 + chunks))
            results[f"{mode}_one_by_one_ms_p50"] = alone["ack_ms_p50"]
            steady = _steady(config, seconds)
            for share in (50, 99):
                results[f"{mode}_steady_ms_p{share}"] = 1e3 * float(np.percentile(steady, share))
            taken, processor = deliver(config, processes, chunks)
            results[f"{mode}_steps_per_s"] = processes * chunks * STEPS / taken
            results[f"{mode}_learner_us_per_chunk"] = 1e6 * processor / (processes * chunks)
    return results


@contextlib.contextmanager
def _learner(interval: float | None) -> Iterator[BusConfig]:
    """Run what takes deliveries in a learner."""
    bus = BusConfig(listen=f"tcp/127.0.0.1:{free_port()}")
    config = RunConfig(bus=bus)
    with tempfile.TemporaryDirectory(dir=Path.cwd(), prefix=".bench-") as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        replay = ReplayBuffer(config.replay.capacity, config.replay.max_bytes)
        journal = stack.enter_context(Journal(folder / "journal"))
        commit = stack.enter_context(GroupCommit(journal, interval or config.journal.sync_seconds))
        episodes = EpisodeLog(folder / "episodes.jsonl")
        stack.callback(episodes.close)
        ingest = Ingest(config, replay, RateLimiter(1.0, 10**9, 1), journal, episodes)
        session = stack.enter_context(open_learner_session(bus))
        when = None if interval is None else commit.when_synced
        server = ExperienceServer(session, RUN, new_incarnation(), ingest.store, when_durable=when)
        stack.enter_context(server)
        yield bus


def _steady(config: BusConfig, seconds: float) -> list[float]:
    """Send at a steady rate; return the seconds from each query to its acknowledgement, without the first second."""
    body, incarnation = chunk(), new_incarnation()
    took: dict[int, float] = {}
    count = int(seconds * PER_SECOND)
    with open_client_session(config) as session:
        time.sleep(1.0)
        began = time.perf_counter()
        for number in range(count):
            time.sleep(max(0.0, began + number / PER_SECOND - time.perf_counter()))
            data = encode(Delivery("bench-steady", incarnation, number, body))
            sent = time.perf_counter()

            def heard(reply: zenoh.Reply, number: int = number, sent: float = sent) -> None:
                if reply.ok is not None:
                    took[number] = time.perf_counter() - sent

            handler = zenoh.handlers.Callback(heard, lambda: None, indirect=False)
            session.get(Keys(RUN).experience("bench-steady"), handler, payload=data, timeout=10.0)
        time.sleep(1.0)
    if len(took) < count:
        raise RuntimeError(f"{count - len(took)} of {count} messages were not acknowledged")
    return [seconds for number, seconds in took.items() if number >= PER_SECOND]


def _sync_seconds(repeats: int = 50) -> float:
    """Median time of a sync behind 64 KiB of new data in the current folder."""
    times = []
    with tempfile.TemporaryFile(dir=Path.cwd()) as file:
        for _ in range(repeats):
            os.write(file.fileno(), bytes(1 << 16))
            began = time.perf_counter()
            os.fdatasync(file.fileno())
            times.append(time.perf_counter() - began)
    return float(np.median(times))


if __name__ == "__main__":
    for name, value in run().items():
        print(f"{name:40s} {value:12.1f}")
