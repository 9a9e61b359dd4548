"""The life of a bridge process: it runs until a signal ends it."""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from deploy.bridge.bridge import Bridge
from deploy.config import DeployConfig

log = logging.getLogger(__name__)


def run_bridge(config: DeployConfig) -> None:
    """Run a bridge until SIGINT or SIGTERM.

    Raises:
        HDError: it cannot start.
    """
    stop = threading.Event()
    with _signals_set(stop), Bridge(config) as bridge:
        log.info(
            "robot %r: %s by %s, %s; waiting for %s",
            config.name,
            config.decision.task,
            config.decision.planner,
            "driving itself" if config.driving.enabled else "the robot's own stack drives",
            "map and pose" if config.decision.autostart else "the command to start",
        )
        bridge.run(stop)
        log.info("the bridge ends")


@contextmanager
def _signals_set(stop: threading.Event) -> Iterator[None]:
    """Set `stop` on SIGINT and SIGTERM within the `with`; a second SIGINT is a KeyboardInterrupt."""

    def on_signal(number: int, frame: FrameType | None) -> None:
        del frame
        if stop.is_set() and number == signal.SIGINT:
            raise KeyboardInterrupt
        stop.set()

    before = {number: signal.signal(number, on_signal) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
