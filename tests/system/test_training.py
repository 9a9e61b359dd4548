"""A learner and two actors as processes, killed in the middle: nothing acknowledged is lost or counted twice."""

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from common.bus.control import request
from common.bus.session import open_client_session
from common.config import BusConfig
from common.errors import BusError
from common.messages.experience import Chunk, Delivery
from common.messages.schema import decode
from learner.run.journal import Journal, RecordKind

STEPS = 400
ACKNOWLEDGED = re.compile(r"(system-\d+) \| .*message (\d+) of incarnation (\d+) is acknowledged")
SETTINGS = [
    "maps.train=generator:rooms?width=320&height=240",
    "network.width=16",
    "network.heads=2",
    "network.layers=1",
    "mapping.resolution=0.5",
    "replay.min_steps=40",
    "learner.batch_size=8",
    "learner.updates_per_step=0.1",
    "learner.total_updates=1000000",
    "learner.publish_every=2",
    "learner.threads=1",
    "checkpoints.every_seconds=1",
    "actor.chunk_steps=4",
    # Actors must wait, not drive on for minutes, while a learner starts.
    "actor.buffer_chunks=16",
]


class System:
    """The processes of one run, and what they write."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        with socket.socket() as found:
            found.bind(("127.0.0.1", 0))
            self.endpoint = f"tcp/127.0.0.1:{found.getsockname()[1]}"
        self.environment = {key: value for key, value in os.environ.items() if not key.startswith("HD_")}
        self.processes: list[subprocess.Popen] = []

    def start(self, name: str, *command: str) -> subprocess.Popen:
        with (self.folder / f"{name}.log").open("a") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", *command], stdout=log, stderr=log, env=self.environment, cwd=self.folder
            )
        self.processes.append(process)
        return process

    def learner(self, verb: str) -> subprocess.Popen:
        settings = [part for setting in SETTINGS for part in ("--set", setting)]
        return self.start(
            "learner",
            "learner",
            verb,
            "--run",
            "system",
            "--listen",
            self.endpoint,
            *(settings if verb == "start" else []),
        )

    def stop(self) -> None:
        with open_client_session(BusConfig(), [self.endpoint]) as session:
            request(session, "system", "stop", 30.0)

    def wait_for(self, condition, seconds: float) -> dict:
        """Ask for the status until it meets a condition; fail with both logs when it does not in time."""
        status, end = {}, time.monotonic() + seconds
        # Asked in this process: one of its own for each question would take its time from those that it asks about.
        with open_client_session(BusConfig(), [self.endpoint]) as session:
            while time.monotonic() < end:
                with contextlib.suppress(BusError):
                    status = request(session, "system", "status", 5.0)
                    if condition(status):
                        return status
                time.sleep(0.1)
        logs = "".join(f"--- {file.name}\n{file.read_text()[-3000:]}" for file in self.folder.glob("*.log"))
        raise AssertionError(f"not in {seconds} s: {json.dumps(status)[:3000]}\n{logs}")

    def close(self) -> None:
        for process in self.processes:
            with contextlib.suppress(psutil.NoSuchProcess):
                for child in psutil.Process(process.pid).children(recursive=True):
                    child.kill()
            process.kill()
            process.wait()


@pytest.fixture
def system(tmp_path):
    built = System(tmp_path)
    yield built
    built.close()


def alive(status: dict) -> dict[str, dict]:
    return {actor["name"]: actor for actor in status["actors"] if actor["alive"] and actor["role"] == "actor"}


@pytest.mark.timeout(400)
def test_training_survives_the_death_of_an_actor_and_of_the_learner(system):
    learner = system.learner("start")
    system.wait_for(lambda status: True, 150)
    options = ["--num", "2", "--connect", system.endpoint, "--run", "system", "--sim", "grid", "--name", "system"]
    actors = system.start("actors", "actors", *options, "--log-level", "debug")

    status = system.wait_for(
        lambda s: (
            s["steps"] >= 100
            and len(alive(s)) == 2
            and all(a["steps"] and a["version"] >= 2 for a in alive(s).values())
        ),
        150,
    )
    versions = {name: actor["version"] for name, actor in alive(status).items()}

    victim = next(child for child in psutil.Process(actors.pid).children() if "actors.process" in child.cmdline())
    victim.kill()
    status = system.wait_for(lambda s: s["steps"] >= 200, 60)

    learner.send_signal(signal.SIGKILL)
    learner.wait()
    learner = system.learner("resume")
    status = system.wait_for(
        lambda s: (
            s["steps"] >= STEPS
            and len(alive(s)) == 2
            and all(actor["steps"] and actor["version"] > versions[name] for name, actor in alive(s).items())
        ),
        150,
    )
    assert status["refused"] == 0

    began = time.monotonic()
    actors.send_signal(signal.SIGINT)
    assert actors.wait(20) == 0
    assert time.monotonic() - began < 8.0, "actors took too long to end (three seconds on an idle machine)"
    final = system.wait_for(lambda status: True, 60)
    system.stop()
    assert learner.wait(60) == 0

    log = (system.folder / "actors.log").read_text()
    assert "killed" in log or "signal 9" in log or "SIGKILL" in log
    acknowledged = {
        (name, int(sequence), int(incarnation)) for name, sequence, incarnation in ACKNOWLEDGED.findall(log)
    }
    stored = []
    steps = 0
    with Journal(system.folder / "runs" / "system" / "journal") as journal:
        for record in journal.read():
            if record.kind is RecordKind.DELIVERY:
                delivery = decode(record.payload, Delivery)
                stored.append((delivery.actor, delivery.sequence, delivery.incarnation))
                steps += delivery.body.steps if isinstance(delivery.body, Chunk) else 0
    assert len(acknowledged) > 70
    assert acknowledged <= set(stored), "something acknowledged was lost"
    assert len(stored) == len(set(stored)), "something was stored twice"
    assert steps == final["steps"], "the learner counts other steps than it stored"
    assert len({incarnation for _, _, incarnation in stored}) == 3, "two actors, one of them twice"
