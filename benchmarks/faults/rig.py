"""A real learner behind a link that can fail, real actors, and the books: what was acknowledged and what is stored."""

from __future__ import annotations

import contextlib
import hashlib
import json
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.children import ROOT, child_environment
from benchmarks.faults.actors import RUN, Orders
from benchmarks.link import Link
from common.bus.control import request
from common.bus.session import open_client_session
from common.config import BusConfig
from common.errors import BusError, HDError, MessageError
from common.messages.experience import Chunk, Delivery
from common.messages.schema import decode
from common.system.closing import Closing
from common.system.runtime import python_module
from learner.run.records import Found, RecordKind, scan, segment_paths
from tests.rigs.disk import SmallDisk
from tests.rigs.learner import SETTINGS, Learner

# A learner that is kept by nothing but faults: seldom an update, and no pause for actors that are ahead of it.
RIG_SETTINGS = [
    *SETTINGS[:-1],
    "checkpoints.every_seconds=2",
    "learner.ratio_tolerance=1000000000",
    "replay.capacity=500000",
]
START_SECONDS = 200.0

Key = tuple[str, int, int]
"""Actor, its incarnation, and the sequence number of its message, as the learner tells messages apart."""


class FaultError(HDError):
    """A fault cannot be tried."""


class Actors:
    """A process of actors, see `benchmarks.faults.actors`."""

    def __init__(self, mode: str, orders: Orders, prefix: tuple[str, ...] = ()) -> None:
        self._mode = mode
        self._process = subprocess.Popen(
            [*prefix, *python_module("benchmarks.faults.actors", mode, orders.text())],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=child_environment(),
        )

    def finish(self, seconds: float) -> dict[str, float]:
        """Let it come to its end; return its figures.

        Raises:
            FaultError: it failed, took longer, or something that it delivered was not acknowledged.
        """
        try:
            out, _ = self._process.communicate("", timeout=seconds)
        except subprocess.TimeoutExpired:
            raise FaultError(f"the {self._mode} actors have not ended within {seconds:g} s") from None
        if self._process.returncode or not out.strip():
            raise FaultError(f"the {self._mode} actors ended with exit code {self._process.returncode}")
        figures: dict[str, float] = json.loads(out.splitlines()[-1])
        if figures.get("missing"):
            raise FaultError(f"{figures['missing']:,.0f} messages of the {self._mode} actors were not acknowledged")
        return figures

    def end(self) -> None:
        """Kill it if it still runs."""
        with contextlib.suppress(ProcessLookupError):
            self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None and not pipe.closed:
                with contextlib.suppress(BrokenPipeError):
                    pipe.close()


class Rig(Closing):
    """A learner and two actors that deliver all the time, through a link.

    Usage::

        with Rig(folder) as rig:
            rig.learner.kill()
            since = time.monotonic()
            rig.learner.launch("resume")
            rig.resumed(since)
            rig.books()

    Args:
        folder: for everything; made when missing.
        disk: that the run lies on, where it can be filled.
        rate: messages that each of the two actors delivers, per second.

    Attributes:
        learner: its process.
        link: between the learner and its actors.
    """

    def __init__(self, folder: Path, disk: SmallDisk | None = None, rate: float = 50.0) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.disk = disk
        self._acks = folder / "acknowledged"
        self._acks.touch()
        self._read = 0
        self._acknowledged: dict[tuple[int, int], float] = {}
        self.learner = Learner(disk.path if disk else folder, RIG_SETTINGS)
        self.learner.log = folder / "learner.log"
        self.link = Link(self.learner.endpoint)
        self._actors: list[Actors] = []
        self._entries: dict[bytes, tuple[Key, int | None]] = {}
        self.damaged: dict[Key, int | None] = {}
        """Deliveries that were damaged on purpose, as `stored` has them."""
        self._session = open_client_session(BusConfig(), [self.learner.endpoint])
        self.learner.launch("start")
        self.honest("desk", number=2, rate=rate)
        if self.resumed(0.0, START_SECONDS) is None:
            raise FaultError(f"nothing is acknowledged within {START_SECONDS:g} s:\n{self.log()[-3000:]}")

    def orders(self, name: str, *, endpoint: str = "", **details: Any) -> Orders:
        """Make orders for actors of this rig, which join through the link unless an endpoint is given."""
        return Orders(BusConfig(listen=endpoint or self.link.endpoint), str(self._acks), name, **details)

    def honest(self, name: str, **details: Any) -> Actors:
        """Start actors that deliver until the rig is closed."""
        return self.start("honest", self.orders(name, **details))

    def start(self, mode: str, orders: Orders, prefix: tuple[str, ...] = ()) -> Actors:
        """Start a process of actors."""
        actors = Actors(mode, orders, prefix)
        self._actors.append(actors)
        return actors

    def acknowledged(self) -> dict[tuple[int, int], float]:
        """Return when each message of an honest actor was acknowledged, monotonic seconds.

        By incarnation and sequence number: no two honest actors share an incarnation. The dictionary grows with each
        call.
        """
        with self._acks.open("rb") as file:
            file.seek(self._read)
            # A line is written at one stroke, so what is there are whole lines.
            new = file.read()
        self._read += len(new)
        for line in new.splitlines():
            incarnation, sequence, moment = line.split()
            self._acknowledged[int(incarnation), int(sequence)] = float(moment)
        return self._acknowledged

    def resumed(self, since: float, seconds: float = 60.0) -> float | None:
        """Wait for the first acknowledgement after a moment; return how long after it came, None if not in time."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            after = [moment for moment in self.acknowledged().values() if moment > since]
            if after:
                return min(after) - since
            time.sleep(0.05)
        return None

    def stored(self) -> dict[Key, int | None]:
        """Read the journal as it is now: the steps of each delivery, None for the report of an episode."""
        found = {}
        for path in segment_paths(self.learner.run_folder / "journal").values():
            with contextlib.suppress(FileNotFoundError):  # an empty segment goes when a learner ends
                for record in list(scan(path)):
                    if isinstance(record, Found) and record.kind == RecordKind.DELIVERY:
                        with contextlib.suppress(MessageError):
                            key, steps = self._entry(record.payload)
                            found[key] = steps
        return found

    def _entry(self, payload: bytes) -> tuple[Key, int | None]:
        """Decode a delivery for the books, unless that was done before; MessageError if it is none."""
        digest = hashlib.blake2b(payload, digest_size=16).digest()
        if digest not in self._entries:
            delivery = decode(payload, Delivery)
            steps = delivery.body.steps if isinstance(delivery.body, Chunk) else None
            self._entries[digest] = (delivery.actor, delivery.incarnation, delivery.sequence), steps
        return self._entries[digest]

    def books(self) -> tuple[int, int, int]:
        """Return how many messages were acknowledged, how many of them are lost, and what is counted too often."""
        known = self.acknowledged()
        state = self.status()
        # Read after the state: what it counts is there by now.
        stored = self.stored()
        ever = {**self.damaged, **stored}
        lost = known.keys() - {(incarnation, sequence) for _, incarnation, sequence in ever}
        steps = sum(each for each in ever.values() if each is not None)
        episodes = sum(each is None for each in ever.values())
        doubled = max(0, state["steps"] - steps) + max(0, state["episodes"] - episodes)
        return len(known), len(lost), doubled

    def status(self) -> dict[str, Any]:
        """Ask the learner for its state."""
        return request(self._session, RUN, "status", 30.0)

    def answers(self) -> bool:
        """Whether the learner answers a command."""
        try:
            return bool(request(self._session, RUN, "status", 5.0))
        except BusError:
            return False

    def log(self) -> str:
        """Everything that the learner said."""
        return self.learner.log.read_text("utf-8", errors="replace")

    @contextlib.contextmanager
    def said(self) -> Iterator[list[str]]:
        """Give, at the end of a `with`, what the learner said meanwhile, as one text in the list."""
        before = len(self.log())
        told: list[str] = []
        yield told
        told.append(self.log()[before:])

    def close(self) -> None:
        """End all processes; safe to call twice."""
        for actors in self._actors:
            actors.end()
        self.learner.end()
        self.link.close()
        self._session.close()
