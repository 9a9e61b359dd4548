"""Questions and answers: the two halves of every request on the bus, neither of which blocks a Zenoh thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from queue import Empty, SimpleQueue

import zenoh

from common.bus.fair_queue import FairQueue
from common.system.closing import Closing
from common.system.threads import Complaints, guarded

RETRY_SECONDS = 0.2
"""Pause before a question is asked again that nobody answered."""


class QueryServer(Closing):
    """Answers the queries of one key in threads of its own.

    Zenoh's receiving threads only put queries into a queue. A query is finished, answered or not, when `answer`
    returns; an exception in it is logged and leaves the query unanswered, so that the asker tries again. Whatever
    happens to one query, the thread takes the next. An `answer` that returns True keeps the query, to reply to it
    and to drop it later from any thread. Sources take turns (`FairQueue`), so whoever asks without end waits behind
    itself and nobody else.

    Usage::

        with QueryServer(session, "hd/run/spec", lambda query: query.reply(query.key_expr, b"...")):
            ...

    Args:
        session: an open session.
        key: to answer, or a selection of keys.
        answer: takes a query, from one of the threads.
        source_of: tells whose a query is, by its key.
        threads: that answer.
        max_waiting: queries that wait at most.
        max_bytes: that they hold together at most.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        answer: Callable[[zenoh.Query], bool | None],
        *,
        source_of: Callable[[str], str] = str,
        threads: int = 1,
        max_waiting: int = 4096,
        max_bytes: int = 1 << 28,
    ) -> None:
        self._complaints = Complaints(f"answering a query on {key}")
        self._answer = answer
        self._source_of = source_of
        self._waiting: FairQueue[zenoh.Query] = FairQueue(max_waiting, max_bytes)
        self._lock = threading.Lock()
        self._closed = False
        self.turned_away = 0
        """Queries dropped unanswered because too many, or too many bytes, were waiting."""
        self._threads = [
            threading.Thread(target=self._work, name=f"answer {key} {i}", daemon=True) for i in range(threads)
        ]
        for thread in self._threads:
            thread.start()
        self._queryable = session.declare_queryable(
            key,
            zenoh.handlers.Callback(guarded(f"taking queries on {key}", self._arrived), indirect=False),
            complete=True,
        )

    def _arrived(self, query: zenoh.Query) -> None:
        size = 0 if query.payload is None else len(query.payload)
        for refused in self._waiting.put(self._source_of(str(query.key_expr)), query, size):
            self.turned_away += 1
            refused.drop()

    def _work(self) -> None:
        while (query := self._waiting.get()) is not None:
            kept: bool | None = False
            with self._complaints:
                kept = self._answer(query)
            if not kept:
                query.drop()
            # Without this the last query stays alive, and unanswered in its asker's eyes, until the next one.
            del query

    def close(self) -> None:
        """Stop answering; queries that wait end unanswered. Safe to call twice."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
        self._queryable.undeclare()
        for query in self._waiting.close():
            query.drop()
        for thread in self._threads:
            # An answer may close its own server, for example a command to stop.
            if thread is not threading.current_thread():
                thread.join()


def ask(
    session: zenoh.Session,
    selector: str,
    timeout: float,
    payload: bytes | None = None,
    *,
    everybody: bool = False,
    attachment: bytes | None = None,
) -> list[zenoh.Reply]:
    """Ask once and return all replies, none when nobody is there.

    Args:
        session: an open session.
        selector: key, and parameters behind a question mark.
        timeout: seconds.
        payload: what goes with the question.
        everybody: ask all who can answer, not just the best one.
        attachment: what goes beside the payload.
    """
    replies: SimpleQueue[zenoh.Reply | None] = SimpleQueue()
    session.get(
        selector,
        zenoh.handlers.Callback(replies.put, lambda: replies.put(None), indirect=False),
        target=zenoh.QueryTarget.ALL if everybody else zenoh.QueryTarget.BEST_MATCHING,
        consolidation=zenoh.ConsolidationMode.NONE,
        timeout=timeout,
        payload=payload,
        attachment=attachment,
    )
    result: list[zenoh.Reply] = []
    deadline = time.monotonic() + timeout + 1.0
    while True:
        try:
            reply = replies.get(timeout=max(0.0, deadline - time.monotonic()))
        except Empty:
            return result
        if reply is None:
            return result
        result.append(reply)


def ask_until_answered(
    session: zenoh.Session,
    selector: str,
    timeout: float,
    payload: bytes | None = None,
    *,
    everybody: bool = False,
    attachment: bytes | None = None,
) -> list[zenoh.Reply]:
    """Ask again and again until somebody answers or the time is up; only for questions that may be repeated."""
    deadline = time.monotonic() + timeout
    while True:
        left = deadline - time.monotonic()
        if left <= 0:
            return []
        replies = ask(session, selector, left, payload, everybody=everybody, attachment=attachment)
        if replies:
            return replies
        time.sleep(max(0.0, min(RETRY_SECONDS, deadline - time.monotonic())))
