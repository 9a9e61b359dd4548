"""The learner's end of the bus for tests: real servers, which keep what arrives."""

from __future__ import annotations

import socket
import threading
import time
from contextlib import ExitStack

from common.bus.experience import ExperienceServer
from common.bus.liveness import PresenceWatcher, declare_presence
from common.bus.seen import SeenSet
from common.bus.session import new_incarnation, open_learner_session
from common.bus.spec import SpecServer
from common.bus.stats import StatsTable
from common.bus.weights import WeightsPublisher
from common.config import BusConfig, RunConfig
from common.messages.experience import Chunk, Delivery
from common.messages.replies import Spec
from common.messages.weights import Weights
from common.network.parameters import initial_parameters

SMALL = {
    "name": "test",
    "maps": {
        "train": ["generator:rooms?width=320&height=240"],
        "validation": ["generator:rooms?width=320&height=240&seed=9"],
        "validation_count": 2,
    },
    "simulator": {"name": "grid"},
    "task": {"max_steps": 12},
    "network": {"width": 16, "heads": 2, "layers": 1},
    "actor": {"chunk_steps": 4},
}


def free_port() -> int:
    """Return a TCP port that is free now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class LearnerEnd:
    """Spec, weights, experience and presence of one run; use it with ``with``."""

    def __init__(self, port: int, **changes: object) -> None:
        self.endpoint = f"tcp/127.0.0.1:{port}"
        self.config = RunConfig.model_validate({**SMALL, "bus": {"listen": self.endpoint}, **changes})
        self.incarnation = new_incarnation()
        self.deliveries: list[Delivery] = []
        self._seen = SeenSet()
        self.hold = 0.0
        self.arrived = threading.Condition()

    def __enter__(self) -> LearnerEnd:
        config = self.config
        with ExitStack() as stack:
            session = stack.enter_context(open_learner_session(BusConfig(listen=self.endpoint)))
            stack.enter_context(declare_presence(session, config.name, "learner", "learner"))
            stack.enter_context(SpecServer(session, Spec(config.name, self.incarnation, config.model_dump_json())))
            self.weights = stack.enter_context(WeightsPublisher(session, config.name))
            self.publish(1)
            self.presence = stack.enter_context(PresenceWatcher(session, config.name))
            self.stats = stack.enter_context(StatsTable(session, config.name))
            self.server = stack.enter_context(ExperienceServer(session, config.name, self.incarnation, self._store))
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def publish(self, version: int, updates: int = 0) -> None:
        """Publish random weights as a version."""
        tensors = initial_parameters(self.config.network, version)
        self.weights.publish(
            Weights.of(tensors, learner=self.incarnation, version=version, updates=updates),
            Weights.of(tensors, learner=self.incarnation, version=version, updates=updates, averaged=True),
        )

    def chunks(self, actor: str | None = None) -> list[Chunk]:
        """Return the chunks that arrived, of one actor or of all."""
        return [
            delivery.body
            for delivery in list(self.deliveries)
            if isinstance(delivery.body, Chunk) and actor in (None, delivery.actor)
        ]

    def wait_for(self, condition, timeout: float = 60.0) -> bool:  # type: ignore[no-untyped-def]
        """Wait until a condition holds; it is asked whenever something arrives, and every tenth of a second."""
        with self.arrived:
            deadline = time.monotonic() + timeout
            while time.monotonic() < deadline:
                if condition():
                    return True
                self.arrived.wait(0.1)
        return bool(condition())

    def _store(self, delivery: Delivery, payload: bytes) -> float:
        with self.arrived:
            if self._seen.add(delivery.actor, delivery.incarnation, delivery.sequence):
                self.deliveries.append(delivery)
            self.arrived.notify_all()
        return self.hold
