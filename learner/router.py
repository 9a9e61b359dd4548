"""A router of the bus between a site's actors and the learner."""

from __future__ import annotations

import logging
import threading
import time

import zenoh

from common.bus.session import open_learner_session
from common.config import BusConfig
from common.errors import ConfigError
from common.system.signals import stopping_signals

logger = logging.getLogger(__name__)

LOOK_SECONDS = 1.0
FIRST_SECONDS = 5.0
"""After which a router says that it has not found the other side."""


def run_router(bus: BusConfig) -> None:
    """Carry messages between those who connect here and the routers or learners of `bus.connect`, until told to stop.

    A link to the learner that breaks is made again; what actors deliver meanwhile waits with them.

    Args:
        bus: where to listen, what to connect to, TLS files and access rules.

    Raises:
        ConfigError: there is nothing to connect to.
        BusError: an endpoint is malformed or taken, or a file is missing.
    """
    if not bus.connect:
        raise ConfigError("a router joins others to a learner: name it with --connect tcp/HOST:7447")
    stop = threading.Event()
    with open_learner_session(bus) as session, stopping_signals(stop.set, stop.is_set):
        logger.info("routing between %s and %s", bus.listen, ", ".join(bus.connect))
        _watch(session, stop, ", ".join(bus.connect))


def _watch(session: zenoh.Session, stop: threading.Event, others: str) -> None:
    """Say when the link to the other side comes and goes, and when it does not come."""
    linked = False
    missed: float | None = time.monotonic() + FIRST_SECONDS
    # Not the event's own wait: its lock is no place for a signal handler that sets it.
    pause = threading.Event()
    while not stop.is_set():
        if linked != (linked := bool(session.info.routers_zid())):
            logger.log(logging.INFO if linked else logging.WARNING, "%s %s", "joined" if linked else "lost", others)
            missed = None
        if missed is not None and time.monotonic() >= missed:
            missed = None
            logger.warning(
                "nobody answers at %s yet: check address, port, firewall and certificates; this router goes on trying",
                others,
            )
        pause.wait(LOOK_SECONDS)
