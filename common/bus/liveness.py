"""Presence: every process holds a token on the bus, and anybody can watch who is there."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable

import zenoh

from common.bus.keys import Keys, Role, process_of
from common.errors import BusError
from common.system.closing import Closing
from common.system.threads import guarded

log = logging.getLogger(__name__)

Process = tuple[str, str]
"""(role, name) of a process."""
MAX_PRESENT = 20_000
"""Processes that a watcher knows at most: twice as many as a learner takes."""


def declare_presence(session: zenoh.Session, run: str, role: Role, name: str) -> zenoh.LivelinessToken:
    """Show that a process is there; keep the token, and use it with ``with`` or undeclare it at the end.

    The token goes when the session closes, when the process dies (within milliseconds), or when nothing is heard of
    it for the lease of its session. The learner's name is ``learner``: the weights of actors depend on it.
    """
    return session.liveliness().declare_token(Keys(run).live(role, name))


def present(session: zenoh.Session, run: str, timeout: float = 1.0) -> frozenset[Process]:
    """Return who is there now, asking once."""
    found = set()
    for reply in session.liveliness().get(Keys(run).all_live, timeout=timeout):
        if reply.ok is not None:
            with contextlib.suppress(BusError):  # no process of ours has such a name
                found.add(process_of(str(reply.ok.key_expr)))
    return frozenset(found)


class PresenceWatcher(Closing):
    """Knows who is there.

    Usage::

        with PresenceWatcher(session, "run") as watcher:
            watcher.wait_for(lambda present: ("learner", "learner") in present, timeout=3.0)

    Args:
        session: an open session.
        run: name of the run.
        on_change: called with (role, name) and True when a process appears, False when it is gone; in a thread
            of Zenoh, so it must not block.
    """

    def __init__(
        self, session: zenoh.Session, run: str, on_change: Callable[[Process, bool], None] | None = None
    ) -> None:
        self._present: set[Process] = set()
        self._full = False
        self._changed = threading.Condition()
        self._on_change = on_change
        self._subscriber = session.liveliness().declare_subscriber(
            Keys(run).all_live,
            zenoh.handlers.Callback(guarded("watching presence", self._heard), indirect=False),
            history=True,
        )

    def present(self) -> frozenset[Process]:
        """Return (role, name) of all processes that are there."""
        with self._changed:
            return frozenset(self._present)

    def names(self, role: Role) -> tuple[str, ...]:
        """Return the names of all processes of one role, sorted."""
        return tuple(sorted(name for known, name in self.present() if known == role))

    def wait_for(self, condition: Callable[[frozenset[Process]], bool], timeout: float | None = None) -> bool:
        """Wait until a condition on the set of processes holds; return whether it does."""
        with self._changed:
            return self._changed.wait_for(lambda: condition(frozenset(self._present)), timeout)

    def close(self) -> None:
        """Stop watching. Safe to call twice."""
        self._subscriber.undeclare()

    def _heard(self, sample: zenoh.Sample) -> None:
        try:
            process = process_of(str(sample.key_expr))
        except BusError as error:
            log.debug("ignored the presence of a stranger: %s", error)
            return
        appeared = sample.kind == zenoh.SampleKind.PUT
        with self._changed:
            if appeared == (process in self._present):
                return
            if appeared and len(self._present) >= MAX_PRESENT:
                if not self._full:
                    self._full = True
                    log.warning("%d processes are present, and further ones are not shown", MAX_PRESENT)
                return
            if appeared:
                self._present.add(process)
            else:
                self._present.discard(process)
            self._changed.notify_all()
        if self._on_change is not None:
            self._on_change(process, appeared)
