"""The actor's half of delivery: every message is sent until the learner says that it has it."""

from __future__ import annotations

import logging
import threading
import time
from collections import OrderedDict
from dataclasses import dataclass
from functools import partial
from itertools import islice
from queue import Empty, SimpleQueue

import zenoh

from common.bus.keys import Keys
from common.bus.query import RETRY_SECONDS
from common.bus.session import new_incarnation
from common.errors import MessageError
from common.messages.experience import Chunk, Delivery, EpisodeReport
from common.messages.replies import Ack
from common.messages.schema import decode, encode
from common.system.closing import Closing
from common.system.threads import Complaints, guarded

log = logging.getLogger(__name__)

# Zenoh answers a query itself when nobody did within its timeout.
ZENOH_TIMEOUT = b"Timeout"
MAX_PATIENCE = 30.0
"""Seconds that a message is waited for at most, of a learner that has much to do."""


@dataclass(slots=True)
class _Parcel:
    """One message that is not acknowledged yet."""

    data: bytes
    attempt: int = 0
    in_flight: bool = False
    sent: float = 0.0
    """When it was sent last, monotonic seconds."""
    due: float = 0.0
    """When in flight: the time to give up; else: the earliest time to send again."""


# What Zenoh's threads report: the sequence, the attempt, and the reply or None at the end of the query.
_Event = tuple[int, int, zenoh.Reply | None]


class ExperienceSender(Closing):
    """Delivers chunks and reports in order of their sequence, several at a time, each until it is acknowledged.

    Messages wait in a bounded buffer while the learner is away. All methods may be called from any thread.

    A learner that takes its time is waited for: fewer messages are in flight after one that was not answered, and more
    again with every answer, and each is waited for four times as long as the last one took. Sending again what only
    waits its turn would keep a full learner full.

    Usage::

        with ExperienceSender(session, "run", "desk-0") as sender:
            sender.send(chunk)
            time.sleep(sender.hold)
            sender.flush(timeout=3.0)

    Args:
        session: an open session.
        run: name of the run.
        actor: name of this actor.
        window: messages in flight at most.
        buffer: messages held at most, those in flight included.
        ack_timeout: seconds to wait for an acknowledgement before a message is sent again; longer, up to half a
            minute, while the learner is slow.
    """

    def __init__(
        self,
        session: zenoh.Session,
        run: str,
        actor: str,
        *,
        window: int = 16,
        buffer: int = 512,
        ack_timeout: float = 3.0,
    ) -> None:
        self._session = session
        self._key = Keys(run).experience(actor)
        self.actor = actor
        self.incarnation = new_incarnation()
        """Random number of this sender: the sequence starts at 0 with it."""
        self._window = window
        self._capacity = buffer
        self._ack_timeout = ack_timeout
        self._allowed = window
        self._patience = ack_timeout
        self._parcels: OrderedDict[int, _Parcel] = OrderedDict()
        self._events: SimpleQueue[_Event | None] = SimpleQueue()
        self._changed = threading.Condition()
        self._sequence = 0
        self._closed = False
        self._present = False
        self._hold_until = 0.0
        self._learner = -1
        self._full = False
        self._refusal_said = float("-inf")
        self.acknowledged = 0
        """Messages that the learner has stored."""
        self.refused = 0
        """Messages that the learner refused for good; the log has the reason, once a second at most."""
        self._thread = threading.Thread(target=self._work, name=f"deliver {actor}", daemon=True)
        self._thread.start()

    @property
    def _longest(self) -> float:
        return max(self._ack_timeout, MAX_PATIENCE)

    @property
    def pending(self) -> int:
        """Messages that are not acknowledged yet."""
        return len(self._parcels)

    @property
    def learner_present(self) -> bool:
        """Whether the learner answered the last time."""
        return self._present

    @property
    def learner(self) -> int:
        """Incarnation of the learner that answered last, -1 before the first answer."""
        return self._learner

    @property
    def hold(self) -> float:
        """Seconds from now that the learner wants this actor to pause; 0 when it need not."""
        return max(0.0, self._hold_until - time.monotonic())

    def send(self, body: Chunk | EpisodeReport, timeout: float | None = None) -> bool:
        """Take a message for delivery.

        Args:
            body: what to deliver.
            timeout: seconds to wait for room in the buffer; forever when not given.

        Returns:
            False when there was no room in time, or the sender is closed; the message was not taken then.
        """
        with self._changed:
            if len(self._parcels) >= self._capacity and not self._full and not self._present:
                self._full = True
                log.warning("%d messages wait for the learner, the buffer is full: pausing", len(self._parcels))
            self._changed.wait_for(lambda: self._closed or len(self._parcels) < self._capacity, timeout)
            if self._closed or len(self._parcels) >= self._capacity:
                return False
            delivery = Delivery(self.actor, self.incarnation, self._sequence, body)
            self._parcels[self._sequence] = _Parcel(encode(delivery))
            self._sequence += 1
        self._events.put(None)
        return True

    def flush(self, timeout: float | None = None) -> bool:
        """Wait until everything is acknowledged; return False when the time is up before."""
        with self._changed:
            return self._changed.wait_for(lambda: self._closed or not self._parcels, timeout) and not self._parcels

    def close(self) -> None:
        """Stop at once; what is not acknowledged yet is given up, and the log says so. Safe to call twice."""
        with self._changed:
            if self._closed:
                return
            self._closed = True
            self._changed.notify_all()
        self._events.put(None)
        self._thread.join()
        if self._parcels:
            log.warning("closed with %d messages that the learner did not acknowledge", len(self._parcels))

    def _work(self) -> None:
        # This thread alone delivers: only the end of its session may end it.
        complaints = Complaints(f"delivery of {self.actor}", self._session.is_closed)
        while not self._closed:
            with complaints:
                self._wait_for_events()
                self._send_what_is_due()
                continue
            if self._session.is_closed():
                with self._changed:
                    self._closed = True
                    self._changed.notify_all()
            time.sleep(RETRY_SECONDS)

    def _wait_for_events(self) -> None:
        """Wait for the next event or due time, then handle all events that are there."""
        with self._changed:
            due = min((parcel.due for parcel in self._sendable()), default=None)
        pause = None if due is None else max(0.0, due - time.monotonic())
        try:
            event = self._events.get(timeout=pause)
            while True:
                if event is not None:
                    self._handle(*event)
                event = self._events.get_nowait()
        except Empty:
            pass

    def _sendable(self) -> list[_Parcel]:
        """The parcels within the window; only the oldest while nobody answers, as a probe."""
        return [parcel for _, parcel in self._within_window()]

    def _within_window(self) -> list[tuple[int, _Parcel]]:
        """Return the parcels less than one window ahead of the oldest; the oldest alone while nobody answers."""
        if not self._parcels:
            return []
        end = next(iter(self._parcels)) + (self._allowed if self._present else 1)
        return [item for item in islice(self._parcels.items(), self._window) if item[0] < end]

    def _send_what_is_due(self) -> None:
        now = time.monotonic()
        with self._changed:
            lost = [item for item in self._within_window() if item[1].in_flight and item[1].due <= now]
        for sequence, parcel in lost:
            self._unanswered(sequence, parcel)
        with self._changed:
            due = [item for item in self._within_window() if not item[1].in_flight and item[1].due <= now]
        for sequence, parcel in due:
            parcel.attempt += 1
            parcel.in_flight = True
            parcel.sent = time.monotonic()
            # Zenoh ends a query at its timeout; the second on top covers a session that died meanwhile.
            parcel.due = parcel.sent + self._patience + 1.0
            self._session.get(
                self._key,
                zenoh.handlers.Callback(
                    guarded("hearing an answer", partial(self._on_reply, sequence, parcel.attempt)),
                    guarded("hearing the end of a query", partial(self._on_end, sequence, parcel.attempt)),
                    indirect=False,
                ),
                payload=parcel.data,
                timeout=self._patience,
                consolidation=zenoh.ConsolidationMode.NONE,
            )

    def _on_reply(self, sequence: int, attempt: int, reply: zenoh.Reply) -> None:
        self._events.put((sequence, attempt, reply))

    def _on_end(self, sequence: int, attempt: int) -> None:
        self._events.put((sequence, attempt, None))

    def _handle(self, sequence: int, attempt: int, reply: zenoh.Reply | None) -> None:
        parcel = self._parcels.get(sequence)
        if reply is None:
            if parcel is not None and parcel.in_flight and parcel.attempt == attempt:
                self._unanswered(sequence, parcel)
            return
        answer = reply.ok if reply.ok is not None else reply.err
        data = b"" if answer is None else answer.payload.to_bytes()
        if reply.ok is None and data == ZENOH_TIMEOUT:
            return  # Zenoh's own word that nobody answered in time; the end of the query follows
        try:
            ack = decode(data, Ack)
        except MessageError as error:
            log.warning("an answer of the learner cannot be read: %s", error)
            return
        self._heard(ack)
        if parcel is None:
            return
        took = time.monotonic() - parcel.sent
        self._allowed = min(self._window, self._allowed + 1)
        self._patience = min(self._longest, max(self._ack_timeout, 4.0 * took, 0.9 * self._patience))
        if ack.stored and ack.sequence != sequence:
            log.warning("message %d was acknowledged as %d: sending it again", sequence, ack.sequence)
            self._unanswered(sequence, parcel)
            return
        if ack.stored or ack.error:
            self._done(sequence, ack)
        else:
            parcel.in_flight = False
            parcel.due = time.monotonic() + max(ack.hold, RETRY_SECONDS)

    def _heard(self, ack: Ack) -> None:
        if not self._present:
            self._present = True
            log.info("the learner answers; %d messages to deliver", len(self._parcels))
        if self._learner not in (-1, ack.learner):
            log.info("the learner was restarted; continuing")
        self._learner = ack.learner
        self._hold_until = time.monotonic() + ack.hold

    def _done(self, sequence: int, ack: Ack) -> None:
        if ack.stored:
            self.acknowledged += 1
            log.debug("message %d of incarnation %d is acknowledged", sequence, self.incarnation)
        else:
            self.refused += 1
            now = time.monotonic()
            if now - self._refusal_said >= 1.0:
                self._refusal_said = now
                log.error("the learner refused message %d (%d so far): %s", sequence, self.refused, ack.error)
        with self._changed:
            del self._parcels[sequence]
            # One line per stall, not one per message: the line is due again once half of the buffer is free.
            self._full = self._full and 2 * len(self._parcels) > self._capacity
            self._changed.notify_all()

    def _unanswered(self, sequence: int, parcel: _Parcel) -> None:
        now = time.monotonic()
        parcel.in_flight = False
        parcel.due = now + RETRY_SECONDS
        self._allowed = max(1, self._allowed // 2)
        took = now - parcel.sent
        if took > 0.9 * self._ack_timeout:
            # It may be waiting its turn; a query that nobody takes ends at once.
            self._patience = min(self._longest, max(self._patience, 2.0 * took))
        if self._present:
            self._present = False
            log.warning(
                "the learner does not answer (message %d); continuing, with room for %d more messages",
                sequence,
                self._capacity - len(self._parcels),
            )
