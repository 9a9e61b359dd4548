"""Processes that deliver to a learner: ``python -m benchmarks.faults.actors MODE JSON``.

Modes are `honest` (some senders that deliver until standard input ends), `dying` (one process after the other that is
killed while it delivers) and `hostile` (deliveries that were changed at random, as fast as the learner answers).

What was acknowledged is written, line by line, into a file that outlives the process: incarnation, sequence number and
the monotonic time, which all processes of a Linux machine share. The last line of standard output is a JSON object.
"""

from __future__ import annotations

import contextlib
import json
import logging
import math
import os
import random
import signal
import sys
import threading
import time
from dataclasses import asdict, dataclass

import numpy as np
import zenoh

from benchmarks.faults.mutation import mutated
from common.bus.experience import ExperienceSender
from common.bus.keys import Keys
from common.bus.liveness import declare_presence
from common.bus.session import open_client_session
from common.config import BusConfig
from common.messages.experience import Chunk, Delivery, End, EpisodeReport
from common.messages.schema import encode
from common.system.runtime import allow_files
from tests.learner.experience import episode_chunks, episode_report, observation_pool

RUN = "test"
_EPISODES = 20
# A shared machine may take minutes for what two hundred actors say at the same time.
_FLUSH_SECONDS = 240.0


@dataclass(frozen=True, slots=True)
class Orders:
    """What a process of actors is to do.

    Attributes:
        bus: how to join.
        path: of the file of acknowledgements.
        name: before the number of each actor.
        number: of senders; of deaths; of hostile messages.
        rate: messages per second of each honest sender.
        messages: of each honest sender; 0 for as many as come until standard input ends.
        together: processes that live, or messages in flight, at the same time.
        seed: of everything that is random.
    """

    bus: BusConfig
    path: str
    name: str
    number: int = 1
    rate: float = 50.0
    messages: int = 0
    together: int = 1
    seed: int = 0

    def text(self) -> str:
        """Return the orders as an argument."""
        return json.dumps(asdict(self) | {"bus": self.bus.model_dump()})

    @classmethod
    def of(cls, text: str) -> Orders:
        """Read the argument."""
        tree = json.loads(text)
        return cls(**tree | {"bus": BusConfig(**tree["bus"])})


class Book(logging.Handler):
    """Writes down what is acknowledged, as the sender's log has it."""

    def __init__(self, path: str) -> None:
        super().__init__(logging.DEBUG)
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC)

    def emit(self, record: logging.LogRecord) -> None:
        """Write one line at one stroke."""
        if record.levelno == logging.DEBUG and record.args and len(record.args) == 2:
            sequence, incarnation = record.args
            os.write(self._file, f"{incarnation} {sequence} {time.monotonic()}\n".encode())


def bodies(seed: int) -> list[Chunk | EpisodeReport]:
    """Return the messages of some short episodes."""
    rng = np.random.default_rng(seed)
    pool = observation_pool(viewpoints=(2, 25))
    made: list[Chunk | EpisodeReport] = []
    for episode in range(_EPISODES):
        made += episode_chunks(rng, pool, 8, 4, End.TERMINAL, episode=episode)
        made.append(episode_report(distance=100.0 + episode))
    return made


def honest(orders: Orders) -> dict[str, float]:
    """Deliver with each sender until all is said, or standard input ends; then wait for what is missing.

    Returns:
        The longest wait of a sender for its first acknowledgement, and how many messages were not acknowledged.
    """
    made = bodies(orders.seed)
    over = threading.Event()
    waits = [math.inf] * orders.number
    missing = [orders.messages] * orders.number

    def act(number: int) -> None:
        name = f"{orders.name}-{number}"
        began = time.monotonic()
        with (
            open_client_session(orders.bus) as session,
            declare_presence(session, RUN, "actor", name),
            ExperienceSender(session, RUN, name, ack_timeout=1.0) as sender,
        ):
            sent = 0
            while not over.is_set() and (not orders.messages or sent < orders.messages):
                if sender.send(made[sent % len(made)], 0.5):
                    sent += 1
                if sender.acknowledged:
                    waits[number] = min(waits[number], time.monotonic() - began)
                over.wait(max(1.0 / orders.rate, sender.hold))
            sender.flush(_FLUSH_SECONDS)
            missing[number] = sender.pending
            if sender.acknowledged:
                waits[number] = min(waits[number], time.monotonic() - began)

    threads = [threading.Thread(target=act, args=(number,)) for number in range(orders.number)]
    for thread in threads:
        thread.start()
    if not orders.messages:
        sys.stdin.read()
        over.set()
    for thread in threads:
        thread.join()
    return {"longest_wait": max(waits), "missing": sum(missing)}


def dying(orders: Orders) -> dict[str, float]:
    """Let processes deliver and kill each of them in the middle of it."""
    made = bodies(orders.seed)
    chance = random.Random(orders.seed)
    alive: list[tuple[int, float]] = []
    begun = died = 0
    while died < orders.number:
        while begun < orders.number and len(alive) < orders.together:
            # Nothing of Zenoh has been opened in this process, so a copy of it may open a session of its own.
            child = os.fork()
            if child == 0:
                _deliver_until_killed(orders, f"{orders.name}-{begun}", made)
            alive.append((child, time.monotonic() + chance.uniform(0.05, 1.5)))
            begun += 1
        time.sleep(0.01)
        for child, due in alive.copy():
            if time.monotonic() >= due:
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)
                alive.remove((child, due))
                died += 1
    return {"died": died}


def _deliver_until_killed(orders: Orders, name: str, made: list[Chunk | EpisodeReport]) -> None:
    try:
        session = open_client_session(orders.bus)
        presence = declare_presence(session, RUN, "actor", name)
        sender = ExperienceSender(session, RUN, name)
        for body in made * 1000:
            sender.send(body)
            time.sleep(0.005)
        presence.undeclare()
    finally:
        os._exit(1)


def hostile(orders: Orders) -> dict[str, float]:
    """Send changed deliveries, and put them on keys of other messages; count how they are answered."""
    rng = random.Random(orders.seed)
    names = [f"{orders.name}-{number}" for number in range(50)]
    incarnation = rng.getrandbits(60)
    samples = [
        encode(Delivery(name, incarnation, number, body))
        for name, (number, body) in zip(names * 2, enumerate(bodies(orders.seed)), strict=False)
    ]
    counts = {"refused": 0, "taken": 0, "unanswered": 0}
    room = threading.Semaphore(orders.together)
    keys = Keys(RUN)

    with open_client_session(orders.bus) as session:
        for number in range(orders.number):
            at = number % len(samples)
            data = mutated(samples[at], rng)
            if number % 10 == 9:
                session.put(keys.stats("actor", names[at % len(names)]), data)
                continue
            room.acquire()
            answer = [""]

            def hear(reply: zenoh.Reply, answer: list[str] = answer) -> None:
                answer[0] = "taken" if reply.ok is not None else "refused"

            def end(answer: list[str] = answer) -> None:
                counts[answer[0] or "unanswered"] += 1
                room.release()

            session.get(
                keys.experience(names[at % len(names)]),
                zenoh.handlers.Callback(hear, end, indirect=False),
                payload=data,
                timeout=3.0,
                consolidation=zenoh.ConsolidationMode.NONE,
            )
        for _ in range(orders.together):
            room.acquire(timeout=10.0)
    return counts | {"sent": orders.number}


MODES = {"honest": honest, "dying": dying, "hostile": hostile}


def main(mode: str, text: str) -> None:
    """Carry the orders out."""
    orders = Orders.of(text)
    allow_files(65_536)
    log = logging.getLogger("common.bus.sender")
    log.setLevel(logging.DEBUG)
    log.propagate = False
    log.addHandler(Book(orders.path))
    with contextlib.suppress(BrokenPipeError):
        sys.stdout.write(json.dumps(MODES[mode](orders)) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
