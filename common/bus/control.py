"""Commands to the learner, each acknowledged: status, pause, resume, checkpoint, stop."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any

import zenoh

from common.bus.keys import Keys, last_part
from common.bus.query import QueryServer, ask_until_answered
from common.errors import BusError, HDError, MessageError
from common.messages.replies import ControlReply, ControlRequest
from common.messages.schema import MAX_SMALL, decode, encode

log = logging.getLogger(__name__)


class ControlServer(QueryServer):
    """Carries out commands in a thread of its own, one at a time.

    Usage::

        with ControlServer(session, "run", lambda request: {"updates": 12}):
            ...

    Args:
        session: the learner's session.
        run: name of the run.
        handle: carries out a command and returns the learner's state, ready for JSON. An HDError that it raises
            goes to the asker as the answer.
    """

    def __init__(self, session: zenoh.Session, run: str, handle: Callable[[ControlRequest], Mapping[str, Any]]) -> None:
        self._handle = handle
        super().__init__(session, Keys(run).all_control, self._serve)

    def _serve(self, query: zenoh.Query) -> None:
        try:
            reply = ControlReply(True, "", self._handle(_read(query)))
        except HDError as error:
            log.warning("command %s: %s", last_part(str(query.key_expr)), error)
            reply = ControlReply(False, str(error)[:1000], {})
        query.reply(query.key_expr, encode(reply))


def request(
    session: zenoh.Session,
    run: str,
    verb: str,
    timeout: float = 5.0,
    arguments: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Send a command and return the learner's state after it.

    Args:
        session: an open session.
        run: name of the run.
        verb: status, pause, resume, checkpoint or stop; each may be repeated without harm.
        timeout: seconds.
        arguments: JSON object; empty for the verbs of this version.

    Raises:
        BusError: when no learner answers in time, or it answers with an error.
        MessageError: when the answer is invalid.
    """
    data = encode(ControlRequest(verb, arguments or {}))
    for reply in ask_until_answered(session, Keys(run).control(verb), timeout, data):
        if reply.ok is None:
            continue
        answer = decode(reply.ok.payload.to_bytes(), ControlReply)
        if not answer.ok:
            raise BusError(f"the learner of {run!r} refused {verb!r}: {answer.error}")
        return dict(answer.body)
    raise BusError(
        f"no learner of the run {run!r} answered within {timeout:g} s: check that it runs and that the endpoint is "
        "right"
    )


def _read(query: zenoh.Query) -> ControlRequest:
    if query.payload is None or len(query.payload) > MAX_SMALL:
        raise MessageError("control_request", f"must come as a payload of at most {MAX_SMALL} bytes")
    command = decode(query.payload.to_bytes(), ControlRequest)
    verb = last_part(str(query.key_expr))
    if command.verb != verb:
        raise MessageError("control_request.verb", f"must be {verb!r}, as in the key, got {command.verb!r}")
    return command
