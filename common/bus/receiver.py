"""The learner's half of delivery: check, let it be stored, then acknowledge."""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable
from functools import partial

import zenoh

from common.bus.keys import Keys, host_of, last_part
from common.bus.query import QueryServer
from common.errors import HDError, MessageError, RefusedError
from common.messages.experience import Delivery
from common.messages.replies import Ack
from common.messages.schema import MAX_DELIVERY, MAX_HOLD, decode, encode
from common.system.closing import Closing

log = logging.getLogger(__name__)

STORE_FAILED_HOLD = 1.0
"""Seconds after which an actor tries again when the learner could not store."""
_MAX_SENDERS = 1_000


class ExperienceServer(Closing):
    """Receives deliveries, checks them, and acknowledges each after it is stored.

    Usage::

        with ExperienceServer(session, "run", incarnation, ingest.store):
            ...

    Args:
        session: the learner's session.
        run: name of the run.
        learner: incarnation of this learner.
        store: takes a valid delivery and the bytes that it came as, and returns how many seconds its actor should
            pause. The same delivery may come several times, and is to be stored once. Called from one thread, one
            delivery at a time. A RefusedError goes to the actor, which gives the delivery up; after any other error
            nothing is acknowledged and the actor tries again.
        when_durable: calls back, from another thread, once everything stored so far has reached the disk (True) or
            been refused by it (False); messages are acknowledged after that. At once when not given.
        host_of: tells the host of an actor: hosts are served in turn.
        max_waiting: deliveries that wait at most; beyond that those of the host with the most end unanswered.
    """

    def __init__(
        self,
        session: zenoh.Session,
        run: str,
        learner: int,
        store: Callable[[Delivery, bytes], float],
        *,
        when_durable: Callable[[Callable[[bool], None]], None] | None = None,
        host_of: Callable[[str], str] = host_of,
        max_waiting: int = 4096,
    ) -> None:
        self._learner = learner
        self._when_durable = when_durable
        self._store = store
        self.acknowledged = 0
        """Deliveries acknowledged since the start, repeated ones included."""
        self.invalid: Counter[str] = Counter()
        """Messages refused, by the actor whose key they came on."""
        self._warned: dict[str, float] = {}
        self._said = -1.0
        self._server = QueryServer(
            session,
            Keys(run).all_experience,
            self._answer,
            source_of=lambda key: host_of(last_part(key)),
            max_waiting=max_waiting,
        )

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
            ack = self._take(delivery, data)
        except (MessageError, RefusedError) as error:
            self._refuse(query, sender, error)
            return False
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
        try:
            hold = min(max(float(self._store(delivery, data)), 0.0), MAX_HOLD)
        except RefusedError:
            raise
        except HDError as error:
            # Whoever stores says once what is wrong; a full disk would fill the log too.
            log.debug("message %d of %s is not stored: %s", delivery.sequence, delivery.actor, error)
            return Ack(delivery.sequence, False, STORE_FAILED_HOLD, "", self._learner)
        except Exception:
            log.exception("message %d of %s could not be stored", delivery.sequence, delivery.actor)
            return Ack(delivery.sequence, False, STORE_FAILED_HOLD, "", self._learner)
        self.acknowledged += 1
        return Ack(delivery.sequence, True, hold, "", self._learner)

    def _refuse(self, query: zenoh.Query, sender: str, error: HDError) -> None:
        # A hostile peer can invent names: beyond the first thousand they share one counter.
        name = sender if sender in self.invalid or len(self.invalid) < _MAX_SENDERS else "(others)"
        self.invalid[name] += 1
        now = time.monotonic()
        # Once a second for each name, and a few lines a second for all of them.
        if now - self._warned.get(name, -1.0) >= 1.0 and now - self._said >= 0.1:
            self._warned[name] = self._said = now
            log.warning("refused a message of %s (%d so far): %s", name, self.invalid[name], error)
        query.reply_err(encode(Ack(-1, False, 0.0, str(error)[:1000], self._learner)))


def _payload(query: zenoh.Query) -> bytes:
    if query.payload is None:
        raise MessageError("delivery", "must be the payload of the query, got none")
    if len(query.payload) > MAX_DELIVERY:
        raise MessageError("delivery", f"must have at most {MAX_DELIVERY} bytes, got {len(query.payload)}")
    return query.payload.to_bytes()
