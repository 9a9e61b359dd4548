"""Processes that are killed, frozen and restarted."""

import os
import signal

import numpy as np
import pytest

from common.bus.experience import ExperienceSender
from common.bus.liveness import PresenceWatcher
from common.bus.session import open_client_session, open_learner_session
from common.bus.weights import WeightsPublisher, WeightsPuller
from common.messages.weights import Weights
from tests.common.bus.processes import eventually, loopback, python
from tests.common.messages import samples

# A learner whose store outlives it: one line per delivery, written before the acknowledgement.
LEARNER = """
import os, sys, time
from common.bus.experience import ExperienceServer, SeenSet
from common.bus.session import new_incarnation, open_learner_session
from common.config import BusConfig

endpoint, path = sys.argv[1:]
parent = os.getpid()
# Each line begins a learner: a copy of this process, which has everything imported.
for line in sys.stdin:
    child = os.fork()
    if not child:
        break
    print(child, flush=True)
    os.waitpid(child, 0)
else:
    sys.exit()
seen = SeenSet()
if os.path.exists(path):
    for line in open(path):
        actor, incarnation, sequence = line.split()
        seen.add(actor, int(incarnation), int(sequence))
file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)

def store(delivery, payload):
    if seen.add(delivery.actor, delivery.incarnation, delivery.sequence):
        os.write(file, f"{delivery.actor} {delivery.incarnation} {delivery.sequence}\\n".encode())
    return 0.0

with open_learner_session(BusConfig(listen=endpoint)) as session:
    with ExperienceServer(session, "run", new_incarnation(), store):
        print("ready", flush=True)
        while os.getppid() == parent:
            time.sleep(0.1)
"""

ACTOR = """
import sys
from common.bus.experience import ExperienceSender
from common.bus.liveness import declare_presence
from common.bus.session import open_client_session
from common.bus.weights import WeightsPuller
from common.config import BusConfig

with (
    open_client_session(BusConfig(listen=sys.argv[1], lease=float(sys.argv[2]))) as session,
    declare_presence(session, "run", "actor", "desk-9"),
    WeightsPuller(session, "run") as puller,
):
    weights = None
    while True:
        weights = puller.wait(after=weights)
        print(weights.version, flush=True)
"""


def begin(learners):
    """Let a process of `LEARNER` begin a learner; return its number."""
    learners.stdin.write("\n")
    learners.stdin.flush()
    child = int(learners.stdout.readline())
    assert learners.stdout.readline() == "ready\n"
    return child


def stored(path):
    return [tuple(line.split()) for line in path.read_text().splitlines()]


def test_a_killed_learner_loses_nothing_acknowledged_and_counts_nothing_twice(tmp_path):
    config, path = loopback(), tmp_path / "stored"
    count = 600
    with (
        python(LEARNER, config.listen, str(path)) as learners,
        open_client_session(config) as client,
        ExperienceSender(client, "run", "desk-0", ack_timeout=1.0) as sender,
    ):
        sent = 0
        for part in range(1, 4):
            learner = begin(learners)
            while sent < count * part // 3:
                assert sender.send(samples.report(), timeout=10)
                sent += 1
            if part == 3:
                assert sender.flush(20)
            os.kill(learner, signal.SIGKILL)
        assert sender.acknowledged == count
        assert sender.refused == 0
        lines = stored(path)
        assert len(lines) == len(set(lines)), "counted twice"
        assert {int(sequence) for _, _, sequence in lines} == set(range(count)), "lost"


def test_a_frozen_learner_gets_messages_again_and_counts_them_once(tmp_path):
    config, path = loopback(), tmp_path / "stored"
    with python(LEARNER, config.listen, str(path)) as learners, open_client_session(config) as client:
        learner = begin(learners)
        with ExperienceSender(client, "run", "desk-0", ack_timeout=0.4) as sender:
            sender.send(samples.report())
            assert sender.flush(30)
            os.kill(learner, signal.SIGSTOP)
            for _ in range(50):
                sender.send(samples.report())
            assert eventually(lambda: not sender.learner_present)
            assert sender.pending == 50
            os.kill(learner, signal.SIGCONT)
            assert sender.flush(30)
        lines = stored(path)
        assert len(lines) == len(set(lines)) == 51


def test_a_frozen_actor_delays_nobody_and_catches_up():
    config = loopback()
    tensors = {"w": np.zeros(500_000, dtype=np.float32)}
    with (
        open_learner_session(config) as learner,
        WeightsPublisher(learner, "run") as publisher,
        python(ACTOR, config.listen, "30") as frozen,
        open_client_session(config) as client,
        WeightsPuller(client, "run") as healthy,
    ):
        publisher.publish(Weights.of(tensors, learner=1, version=0, updates=0))
        assert frozen.stdout.readline() == "0\n"
        seen = healthy.wait(10)
        frozen.send_signal(signal.SIGSTOP)
        for version in range(1, 15):
            publisher.publish(Weights.of(tensors, learner=1, version=version, updates=version))
            seen = healthy.wait(2, after=seen)
            assert seen is not None, f"version {version} was held up by an actor that is frozen"
            assert seen.version == version
        frozen.send_signal(signal.SIGCONT)
        while int(frozen.stdout.readline()) != 14:
            pass


@pytest.mark.parametrize("way", [signal.SIGKILL, signal.SIGSTOP])
def test_a_dead_or_frozen_actor_is_seen_to_be_gone(way):
    config = loopback()
    with (
        open_learner_session(config) as learner,
        PresenceWatcher(learner, "run") as watcher,
        python(ACTOR, config.listen, "1") as actor,
    ):
        assert watcher.wait_for(lambda there: ("actor", "desk-9") in there, 15)
        actor.send_signal(way)
        assert watcher.wait_for(lambda there: not there, 5)
        if way == signal.SIGSTOP:
            actor.send_signal(signal.SIGCONT)
            assert watcher.wait_for(lambda there: ("actor", "desk-9") in there, 10)


def test_an_actor_notices_a_restarted_learner(tmp_path, caplog):
    caplog.set_level("INFO")
    config, path = loopback(), tmp_path / "stored"
    with (
        python(LEARNER, config.listen, str(path)) as learners,
        open_client_session(config) as client,
        ExperienceSender(client, "run", "desk-0") as sender,
    ):
        incarnations = []
        for _ in range(2):
            learner = begin(learners)
            sender.send(samples.report())
            assert sender.flush(30)
            incarnations.append(sender.learner)
            os.kill(learner, signal.SIGKILL)
        assert incarnations[0] != incarnations[1]
        assert "the learner was restarted" in caplog.text
