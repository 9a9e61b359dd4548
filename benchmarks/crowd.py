"""One learner with many light senders: who is heard, how soon, and what the learner needs for it.

`python -m benchmarks.crowd [--senders 1000] [--processes 8] [--seconds 150] [--rate 0.1] [--steps 0]`: real
deliveries, `rate` a second and sender, to a real learner (`hd-learner start`, a small network): an episode's report
each, or with `--steps` an episode of so many steps in one chunk. Prints the share of messages that were acknowledged,
the share of the sender with the least, the median and the 99th percentile of the time to an acknowledgement, the
learner's memory and how long it took to answer `status`.
"""

from __future__ import annotations

import argparse
import json
import random
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import psutil
import zenoh

from benchmarks.children import child_environment
from common.bus.keys import Keys
from common.bus.session import new_incarnation, open_client_session
from common.bus.spec import fetch_spec
from common.config import BusConfig
from common.messages.experience import Chunk, Delivery, End, EpisodeReport
from common.messages.replies import Ack
from common.messages.schema import decode, encode
from common.system.runtime import python_module
from tests.learner.experience import episode_chunks, episode_report, observation_pool
from tests.rigs.learner import Learner

RUN = "test"
ANSWER_SECONDS = 30.0
START_SECONDS = 180.0
# Of the observations in chunks, on average those of an exploration of a benchmark map.
VIEWPOINTS = (130, 240)
# Different chunks that the senders of one process deliver in turn.
CHUNKS = 16


@dataclass(slots=True)
class Heard:
    """What became of the messages of one process.

    Attributes:
        sent: messages of each sender.
        acknowledged: of those, by sender.
        waits: seconds to each acknowledgement.
    """

    sent: list[int]
    acknowledged: list[int]
    waits: list[float] = field(default_factory=list)


def bodies(steps: int) -> list[Chunk] | list[EpisodeReport]:
    """Return what the senders deliver in turn: a report, or chunks of so many steps, each a whole episode."""
    if not steps:
        return [episode_report()]
    random_numbers = np.random.default_rng(0)
    pool = observation_pool(viewpoints=VIEWPOINTS)
    return [
        chunk
        for episode in range(CHUNKS)
        for chunk in episode_chunks(random_numbers, pool, steps, steps, End.TERMINAL, episode=episode)
    ]


def send(endpoint: str, name: str, senders: int, seconds: float, rate: float, steps: int) -> Heard:
    """Be so many senders, each with messages at random moments, for so long."""
    heard = Heard([0] * senders, [0] * senders)
    delivered = bodies(steps)
    lock, keys, chance = threading.Lock(), Keys(RUN), random.Random(name)
    incarnation = new_incarnation()
    due = sorted((chance.expovariate(rate), number) for number in range(senders))
    with open_client_session(BusConfig(), [endpoint]) as session:
        fetch_spec(session, RUN, START_SECONDS)
        at_body = 0
        began = time.monotonic()
        while due and due[0][0] < seconds:
            at, number = due.pop(0)
            time.sleep(max(0.0, began + at - time.monotonic()))
            message = Delivery(f"{name}-{number}", incarnation, heard.sent[number], delivered[at_body % len(delivered)])
            _deliver(session, keys, number, message, heard, lock)
            at_body += 1
            due.append((at + chance.expovariate(rate), number))
            due.sort()
        end = time.monotonic() + ANSWER_SECONDS
        while sum(heard.acknowledged) < sum(heard.sent) and time.monotonic() < end:
            time.sleep(0.05)
    return heard


def _deliver(
    session: zenoh.Session, keys: Keys, number: int, delivery: Delivery, heard: Heard, lock: threading.Lock
) -> None:
    asked = time.monotonic()

    def answered(reply: zenoh.Reply) -> None:
        if reply.ok is not None and decode(reply.ok.payload.to_bytes(), Ack).stored:
            with lock:
                heard.acknowledged[number] += 1
                heard.waits.append(time.monotonic() - asked)

    heard.sent[number] += 1
    handler = zenoh.handlers.Callback(answered, lambda: None, indirect=False)
    session.get(keys.experience(delivery.actor), handler, payload=encode(delivery), timeout=ANSWER_SECONDS)


def run(
    senders: int = 1000, processes: int = 8, seconds: float = 150.0, rate: float = 0.1, steps: int = 0
) -> dict[str, float]:
    """Let the crowd deliver; return what came of it."""
    with tempfile.TemporaryDirectory() as folder:
        learner = Learner(Path(folder))
        learner.launch("start")
        try:
            with open_client_session(BusConfig(), [learner.endpoint]) as session:
                fetch_spec(session, RUN, START_SECONDS)
            assert learner.process is not None
            memory = psutil.Process(learner.process.pid).memory_info().rss
            orders = [learner.endpoint, str(senders // processes), str(seconds), str(rate), str(steps)]
            crowd = [
                subprocess.Popen(
                    [*python_module("benchmarks.crowd", "--be", f"crowd{number}"), "--orders", *orders],
                    env=child_environment(),
                    stdout=subprocess.PIPE,
                    text=True,
                )
                for number in range(processes)
            ]
            time.sleep(seconds / 2)
            asked = time.monotonic()
            learner.status()
            status_seconds = time.monotonic() - asked
            outputs = [json.loads(process.communicate(timeout=seconds + START_SECONDS)[0]) for process in crowd]
            grown = psutil.Process(learner.process.pid).memory_info().rss - memory
        finally:
            learner.end()
    waits = np.array([wait for each in outputs for wait in each["waits"]])
    acknowledged = [number for each in outputs for number in each["acknowledged"]]
    sent = [number for each in outputs for number in each["sent"]]
    shares = [a / s for a, s in zip(acknowledged, sent, strict=True) if s]
    return {
        "crowd/messages": float(sum(sent)),
        "crowd/messages_per_second": sum(sent) / seconds,
        "crowd/acknowledged_share": sum(acknowledged) / max(sum(sent), 1),
        "crowd/least_share_of_a_sender": min(shares),
        "crowd/acknowledgement_median_ms": 1e3 * float(np.median(waits)),
        "crowd/acknowledgement_p99_ms": 1e3 * float(np.quantile(waits, 0.99)),
        "crowd/acknowledgement_longest_ms": 1e3 * float(waits.max()),
        "crowd/learner_first_megabytes": memory / 1e6,
        "crowd/learner_grown_megabytes": grown / 1e6,
        "crowd/status_seconds": status_seconds,
    }


def main() -> None:
    """Measure, or be one process of the crowd."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--senders", type=int, default=1000)
    parser.add_argument("--processes", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=150.0)
    parser.add_argument("--rate", type=float, default=0.1)
    parser.add_argument("--steps", type=int, default=0)
    parser.add_argument("--be", help=argparse.SUPPRESS)
    parser.add_argument("--orders", nargs=5, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.be:
        endpoint, senders, seconds, rate, steps = given.orders
        heard = send(endpoint, given.be, int(senders), float(seconds), float(rate), int(steps))
        json.dump({"sent": heard.sent, "acknowledged": heard.acknowledged, "waits": heard.waits}, sys.stdout)
        return
    for name, value in run(given.senders, given.processes, given.seconds, given.rate, given.steps).items():
        print(f"{name:45s} {value:12.3f}")


if __name__ == "__main__":
    main()
