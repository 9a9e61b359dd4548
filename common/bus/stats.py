"""Statistics about once a second, for the live view; loss is harmless."""

from __future__ import annotations

import logging
import threading
import time
from collections import OrderedDict

import zenoh

from common.bus.keys import Keys, Role, process_of
from common.bus.liveness import Process
from common.errors import BusError, MessageError
from common.messages.schema import MAX_SMALL, decode, encode
from common.messages.stats import ActorStats, LearnerStats
from common.system.closing import Closing
from common.system.threads import guarded

log = logging.getLogger(__name__)

Stats = ActorStats | LearnerStats
_MAX_PROCESSES = 10_000


def publish_stats(session: zenoh.Session, run: str, role: Role, name: str, stats: Stats) -> None:
    """Send the statistics of one process; never waits, and nobody knows whether they arrive."""
    session.put(
        Keys(run).stats(role, name),
        encode(stats),
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.DATA_LOW,
    )


class StatsTable(Closing):
    """The newest statistics of every process.

    Usage::

        with StatsTable(session, "run") as table:
            for (role, name), (stats, age) in table.rows().items():
                ...
    """

    def __init__(self, session: zenoh.Session, run: str) -> None:
        self._rows: OrderedDict[Process, tuple[Stats, float]] = OrderedDict()
        self._lock = threading.Lock()
        self.invalid = 0
        """Messages that were refused."""
        self._subscriber = session.declare_subscriber(
            Keys(run).all_stats, zenoh.handlers.Callback(guarded("reading statistics", self._heard), indirect=False)
        )

    def rows(self) -> dict[Process, tuple[Stats, float]]:
        """Return the statistics and their age in seconds by (role, name)."""
        now = time.monotonic()
        with self._lock:
            return {process: (stats, now - arrived) for process, (stats, arrived) in self._rows.items()}

    def forget(self, process: Process) -> None:
        """Drop the row of a process that is gone."""
        with self._lock:
            self._rows.pop(process, None)

    def close(self) -> None:
        """Stop listening. Safe to call twice."""
        self._subscriber.undeclare()

    def _heard(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        try:
            role, name = process_of(key)
            if len(sample.payload) > MAX_SMALL:
                raise MessageError("stats", f"must have at most {MAX_SMALL} bytes, got {len(sample.payload)}")
            stats = _of_role(sample.payload.to_bytes(), role, name)
        except (BusError, MessageError) as error:
            self.invalid += 1
            log.debug("refused statistics on %s: %s", key, error)
            return
        with self._lock:
            self._rows[role, name] = (stats, time.monotonic())
            self._rows.move_to_end((role, name))
            if len(self._rows) > _MAX_PROCESSES:
                self._rows.popitem(last=False)


def _of_role(data: bytes, role: str, name: str) -> Stats:
    """Read the statistics that a process of this role and name may send."""
    if role == "learner":
        return decode(data, LearnerStats)
    stats = decode(data, ActorStats)
    if stats.actor != name:
        raise MessageError("actor_stats.actor", f"must be {name!r}, as in the key, got {stats.actor!r}")
    return stats
