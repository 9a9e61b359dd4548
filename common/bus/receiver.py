"""The learner's half of delivery: check, store once, then acknowledge."""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import zenoh

from common.bus.keys import Keys, last_part
from common.bus.query import QueryServer
from common.bus.seen import SeenSet
from common.closing import Closing
from common.errors import HDError, MessageError
from common.messages.experience import Delivery
from common.messages.replies import Ack
from common.messages.schema import MAX_DELIVERY, MAX_HOLD, decode, encode

log = logging.getLogger(__name__)

STORE_FAILED_HOLD = 1.0
"""Seconds after which an actor tries again when the learner could not store."""
_MAX_SENDERS = 1_000


class ExperienceServer(Closing):
    """Receives deliveries; each is stored exactly once, before it is acknowledged.

    Usage::

        with ExperienceServer(session, "run", incarnation, replay.add):
            ...

    Args:
        session: the learner's session.
        run: name of the run.
        learner: incarnation of this learner.
        store: takes a valid new delivery and returns how many seconds its actor should pause. Called from one
            thread, one delivery at a time. When it raises, nothing is acknowledged and the actor tries again.
        journal: takes the raw bytes of a valid new delivery just before `store`; for a log that outlives the
            process.
        state: of an earlier server, from its `state()`.
        when_durable: calls back, from another thread, once everything stored so far has reached the disk (True) or
            been refused by it (False); messages are acknowledged after that. At once when not given.
    """

    def __init__(
        self,
        session: zenoh.Session,
        run: str,
        learner: int,
        store: Callable[[Delivery], float],
        *,
        journal: Callable[[bytes], None] | None = None,
        state: dict[str, Any] | None = None,
        when_durable: Callable[[Callable[[bool], None]], None] | None = None,
    ) -> None:
        self._learner = learner
        self._when_durable = when_durable
        self._store = store
        self._journal = journal
        self._seen = SeenSet()
        if state is not None:
            self._seen.restore(state)
        self._lock = threading.Lock()
        self._hold = 0.0
        self.stored = 0
        """Deliveries stored since the start."""
        self.duplicates = 0
        """Deliveries that came again and were only acknowledged."""
        self.invalid: Counter[str] = Counter()
        """Messages refused, by the actor whose key they came on."""
        self._warned: dict[str, float] = {}
        self._server = QueryServer(session, Keys(run).all_experience, self._answer)

    def state(self) -> dict[str, Any]:
        """Return what was stored so far, ready for JSON; pass it to the next server."""
        with self._lock:
            return self._seen.state()

    def restore(self, state: dict[str, Any]) -> None:
        """Take over what an earlier server stored; raise CheckpointError when it is malformed."""
        with self._lock:
            self._seen.restore(state)

    @contextmanager
    def paused(self) -> Iterator[dict[str, Any]]:
        """Keep deliveries waiting while a consistent snapshot is made; gives the `state()` of that moment."""
        with self._lock:
            yield self._seen.state()

    def close(self) -> None:
        """Stop receiving; actors keep what is not acknowledged. Safe to call twice."""
        self._server.close()

    def _answer(self, query: zenoh.Query) -> bool:
        """Take one query; return whether it is kept until the disk has what it brought."""
        sender = last_part(str(query.key_expr))
        try:
            data = _payload(query)
            delivery = decode(data, Delivery)
            if delivery.actor != sender:
                raise MessageError("delivery.actor", f"must be {sender!r}, as in the key, got {delivery.actor!r}")
        except MessageError as error:
            self._refuse(query, sender, error)
            return False
        ack = self._take(delivery, data)
        if self._when_durable is None or not ack.stored:
            query.reply(query.key_expr, encode(ack))
            return False
        self._when_durable(partial(self._acknowledge, query, ack))
        return True

    def _acknowledge(self, query: zenoh.Query, ack: Ack, durable: bool) -> None:
        with query:
            if not durable:
                ack = Ack(ack.sequence, False, STORE_FAILED_HOLD, "", self._learner)
            query.reply(query.key_expr, encode(ack))

    def _take(self, delivery: Delivery, data: bytes) -> Ack:
        with self._lock:
            if (delivery.actor, delivery.incarnation, delivery.sequence) in self._seen:
                self.duplicates += 1
                return Ack(delivery.sequence, True, self._hold, "", self._learner)
            try:
                if self._journal is not None:
                    self._journal(data)
                self._hold = min(max(float(self._store(delivery)), 0.0), MAX_HOLD)
            except HDError as error:
                # Whoever stores says once what is wrong; a full disk would fill the log too.
                log.debug("message %d of %s is not stored: %s", delivery.sequence, delivery.actor, error)
                return Ack(delivery.sequence, False, STORE_FAILED_HOLD, "", self._learner)
            except Exception:
                log.exception("message %d of %s could not be stored", delivery.sequence, delivery.actor)
                return Ack(delivery.sequence, False, STORE_FAILED_HOLD, "", self._learner)
            self._seen.add(delivery.actor, delivery.incarnation, delivery.sequence)
            self.stored += 1
            return Ack(delivery.sequence, True, self._hold, "", self._learner)

    def _refuse(self, query: zenoh.Query, sender: str, error: MessageError) -> None:
        # A hostile peer can invent names: beyond the first thousand they share one counter.
        name = sender if sender in self.invalid or len(self.invalid) < _MAX_SENDERS else "(others)"
        self.invalid[name] += 1
        now = time.monotonic()
        if now - self._warned.get(name, -1.0) >= 1.0:
            self._warned[name] = now
            log.warning("refused a message of %s (%d so far): %s", name, self.invalid[name], error)
        query.reply_err(encode(Ack(-1, False, 0.0, str(error)[:1000], self._learner)))


def _payload(query: zenoh.Query) -> bytes:
    if query.payload is None:
        raise MessageError("delivery", "must come as the payload of the query, got none")
    if len(query.payload) > MAX_DELIVERY:
        raise MessageError("delivery", f"must have at most {MAX_DELIVERY} bytes, got {len(query.payload)}")
    return query.payload.to_bytes()
