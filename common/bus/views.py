"""Views of episodes over the bus: an actor sends them only while somebody looks, and never more than a few a second."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Collection
from typing import Any, Final

import zenoh

from common.bus.keys import Keys, Role, process_of
from common.bus.liveness import Process
from common.errors import BusError, MessageError
from common.messages.schema import MAX_SMALL, decode, encode
from common.messages.view import EpisodeView
from common.system.closing import Closing
from common.system.threads import guarded

log = logging.getLogger(__name__)

MAX_LOOKED_AT: Final = 8
"""Processes that one watcher looks at, at a time."""
_MAX_OUTCOMES: Final = 64
"""Ends of episodes that wait to be taken; the oldest go."""


class ViewPublisher(Closing):
    """An actor's end: whether somebody looks, and what they get.

    Zenoh tells a publisher whether anybody subscribes to its key, so nobody has to be asked.

    Args:
        session: of the actor.
        run: name of the run.
        role: of the actor.
        name: of the actor.
    """

    def __init__(self, session: zenoh.Session, run: str, role: Role, name: str) -> None:
        keys = Keys(run)
        self._session = session
        self._view, self._outcome = (
            session.declare_publisher(
                key, congestion_control=zenoh.CongestionControl.DROP, priority=zenoh.Priority.DATA_LOW
            )
            for key in (keys.view(role, name), keys.outcome(role, name))
        )

    @property
    def looked_at(self) -> bool:
        """Whether somebody looks at the running episode."""
        return self._wanted(self._view)

    @property
    def outcomes_wanted(self) -> bool:
        """Whether somebody wants to see how episodes end."""
        return self._wanted(self._outcome)

    def send(self, view: EpisodeView, *, outcome: bool = False) -> None:
        """Send a view to whoever looks, or wants outcomes; never waits, and nobody knows whether it arrives."""
        if not self._session.is_closed():
            (self._outcome if outcome else self._view).put(encode(view))

    def close(self) -> None:
        """Take the keys off the bus. Safe to call twice."""
        if not self._session.is_closed():
            self._view.undeclare()
            self._outcome.undeclare()

    def _wanted(self, publisher: zenoh.Publisher) -> bool:
        if self._session.is_closed():
            return False
        # Zenoh's type hints call it a bool.
        status: Any = publisher.matching_status
        return bool(status.matching)


class ViewWatcher(Closing):
    """The newest view of each process that is looked at, and how episodes of evaluation ended.

    Usage::

        with ViewWatcher(open_viewer_session(config.bus), "run") as watcher:
            watcher.look_at({("actor", "desk-0")})
            for (role, name), view in watcher.views().items():
                ...

    Messages are read when they are taken: whatever is sent, a view costs no more than the taking of one.

    Args:
        session: of `open_viewer_session`; it is closed with this.
        run: name of the run.
    """

    def __init__(self, session: zenoh.Session, run: str) -> None:
        self._session = session
        self._keys = Keys(run)
        self._lock = threading.Lock()
        # Held while subscribers come and go, which waits for callbacks that need the other one.
        self._turning = threading.RLock()
        self._newest: dict[str, zenoh.ZBytes] = {}
        self._ended: deque[tuple[str, zenoh.ZBytes]] = deque(maxlen=_MAX_OUTCOMES)
        self._looking: dict[Process, zenoh.Subscriber[None]] = {}
        self.invalid = 0
        """Messages that were refused."""
        self._outcomes = session.declare_subscriber(
            self._keys.all_outcomes,
            zenoh.handlers.Callback(guarded("reading outcomes", self._heard_outcome), indirect=False),
        )

    def look_at(self, processes: Collection[Process]) -> None:
        """Look at these processes from now on, `MAX_LOOKED_AT` of them at most, and at no others.

        Nothing happens once this is closed.
        """
        wanted = set(sorted(processes)[:MAX_LOOKED_AT])
        with self._turning:
            if self._session.is_closed():
                return
            for gone in self._looking.keys() - wanted:
                self._looking.pop(gone).undeclare()
                with self._lock:
                    self._newest.pop(self._keys.view(*gone), None)
            for role, name in wanted - self._looking.keys():
                self._looking[role, name] = self._session.declare_subscriber(
                    self._keys.view(role, name),
                    zenoh.handlers.Callback(guarded("reading views", self._heard), indirect=False),
                )

    def views(self) -> dict[Process, EpisodeView]:
        """Return what came since the last call, the newest of each process."""
        with self._lock:
            newest, self._newest = self._newest, {}
        return {process: view for key, data in newest.items() for process, view in self._read(key, data)}

    def outcomes(self) -> list[EpisodeView]:
        """Return the ends of episodes that came since the last call, oldest first."""
        with self._lock:
            ended = list(self._ended)
            self._ended.clear()
        return [view for key, data in ended for _, view in self._read(key, data)]

    def close(self) -> None:
        """Look at nothing any more. Safe to call twice."""
        with self._turning:
            if not self._session.is_closed():
                self.look_at(())
                self._outcomes.undeclare()
                self._session.close()

    def _heard(self, sample: zenoh.Sample) -> None:
        if self._is_bounded(sample):
            with self._lock:
                self._newest[str(sample.key_expr)] = sample.payload

    def _heard_outcome(self, sample: zenoh.Sample) -> None:
        if self._is_bounded(sample):
            with self._lock:
                self._ended.append((str(sample.key_expr), sample.payload))

    def _is_bounded(self, sample: zenoh.Sample) -> bool:
        bounded = len(sample.payload) <= MAX_SMALL
        self.invalid += not bounded
        return bounded

    def _read(self, key: str, data: zenoh.ZBytes) -> list[tuple[Process, EpisodeView]]:
        """Return who sent a view, and the view; nothing where it is none."""
        try:
            process = process_of(key)
            view = decode(data.to_bytes(), EpisodeView)
            if view.actor != process[1]:
                raise MessageError("episode_view.actor", f"must be {process[1]!r}, as in the key, got {view.actor!r}")
        except (BusError, MessageError) as error:
            self.invalid += 1
            log.debug("refused a view on %s: %s", key, error)
            return []
        return [(process, view)]
