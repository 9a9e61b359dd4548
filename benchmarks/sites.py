"""Two sites joined by a narrow line: what a step costs on it, with and without compression.

`python -m benchmarks.sites [--seconds 20]` (root, for network namespaces): an actor's real messages go to a router of
its site, in a namespace of its own, and over a line of 1 Mbit/s and 50 ms each way to the learner's router. Prints
bytes a step on the line, all protocols and answers included, and steps a second that it carries.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

from actors.collector import Collector
from benchmarks.children import child_environment
from benchmarks.faults.processes import namespace
from benchmarks.link import Link
from common.bus.experience import ExperienceSender, ExperienceServer
from common.bus.session import free_ports, open_client_session, open_learner_session
from common.config import BusConfig, RunConfig
from common.messages.experience import Chunk, Delivery, EpisodeReport
from common.system.runtime import python_module

KILOBITS = 1000
DELAY = 0.05
SITE = "tcp/127.0.0.1:7448"
START_SECONDS = 120.0


def bodies() -> list[Chunk]:
    """Return the chunks of an exploration episode in ``generator:rooms`` by a random policy."""
    config = RunConfig.model_validate(
        {
            "maps": {"train": ["generator:rooms"]},
            "simulator": {"name": "grid"},
            "network": {"width": 16, "heads": 2, "layers": 1},
        }
    )
    found: list[Chunk] = []

    def keep(body: Chunk | EpisodeReport) -> None:
        if isinstance(body, Chunk):
            found.append(body)

    collector = Collector(config, [0], keep)
    try:
        collector.collect()
    finally:
        collector.close()
    return found


def send(compression: bool) -> None:
    """Deliver without end to the router of this site."""
    chunks = bodies()
    bus = BusConfig(compression=compression)
    with open_client_session(bus, [SITE]) as session, ExperienceSender(session, "sites", "far-0", window=4) as sender:
        while True:
            for chunk in chunks:
                while not sender.send(chunk, timeout=1.0):
                    pass


def run(seconds: float = 20.0) -> dict[str, float]:
    """Return bytes a step and steps a second, with and without compression."""
    results: dict[str, float] = {}
    for compression in (False, True):
        steps, sent = _measure(compression, seconds)
        name = "compressed" if compression else "plain"
        results[f"sites/{name}/bytes_per_step"] = sent / max(steps, 1)
        results[f"sites/{name}/steps_per_second"] = steps / seconds
    return results


def _measure(compression: bool, seconds: float) -> tuple[int, int]:
    """Return the steps that arrived in so many seconds, and the bytes that crossed the line towards the learner."""
    stored = [0]

    def store(delivery: Delivery, data: bytes) -> float:
        del data
        stored[0] += delivery.body.steps if isinstance(delivery.body, Chunk) else 0
        return 0.0

    bus = BusConfig(listen=f"tcp/127.0.0.1:{free_ports(1)[0]}", compression=compression)
    with (
        namespace(KILOBITS) as (inside, address, _),
        open_learner_session(bus) as session,
        ExperienceServer(session, "sites", 1, store),
        Link(bus.listen, address) as line,
    ):
        line.delay = DELAY
        subprocess.run([*inside, "ip", "link", "set", "lo", "up"], check=True)
        settings = ["--set", f"bus.compression={str(compression).lower()}"]
        commands = [
            python_module("learner", "router", "--listen", SITE, "--connect", line.endpoint, *settings),
            python_module("benchmarks.sites", "--be", "plain" if not compression else "compressed"),
        ]
        far = [
            subprocess.Popen([*inside, *command], stderr=sys.stderr, env=child_environment()) for command in commands
        ]
        try:
            end = time.monotonic() + START_SECONDS
            while stored[0] == 0:
                if time.monotonic() > end:
                    raise TimeoutError(f"nothing came over the line in {START_SECONDS:.0f} s")
                time.sleep(0.1)
            before, at = stored[0], _received()
            time.sleep(seconds)
            return stored[0] - before, _received() - at
        finally:
            for process in far:
                process.kill()
                process.wait()


def _received() -> int:
    """Return the bytes that came from the namespace so far."""
    return int(Path(f"/sys/class/net/hd{os.getpid() % 100_000}a/statistics/rx_bytes").read_text())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--be", choices=("plain", "compressed"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.be:
        send(given.be == "compressed")
    for name, value in run(given.seconds).items():
        print(f"{name:45s} {value:12.1f}")
