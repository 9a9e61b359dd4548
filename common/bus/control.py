"""Commands to a learner or a robot, each acknowledged."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import zenoh

from common.bus.keys import Keys, last_part
from common.bus.query import QueryServer, ask_until_answered
from common.errors import BusError, HDError, MessageError
from common.messages.replies import VERBS, ControlReply, ControlRequest
from common.messages.schema import MAX_SMALL, decode, encode

log = logging.getLogger(__name__)


class ControlServer(QueryServer):
    """Carries out commands in a thread of its own, one at a time.

    Usage::

        with ControlServer(session, "run", lambda request: {"updates": 12}):
            ...

    Args:
        session: the learner's or robot's session.
        run: name of the run, or of the robot.
        handle: carries out a command and returns the state after it, ready for JSON. An HDError that it raises
            goes to the asker as the answer.
        verbs: commands that are known here; others are refused.
    """

    def __init__(
        self,
        session: zenoh.Session,
        run: str,
        handle: Callable[[ControlRequest], Mapping[str, Any]],
        verbs: Sequence[str] = VERBS,
    ) -> None:
        self._handle = handle
        self._verbs = verbs
        super().__init__(session, Keys(run).all_control, self._serve)

    def _serve(self, query: zenoh.Query) -> None:
        try:
            command = _read(query)
            if command.verb not in self._verbs:
                raise HDError(f"a command must be one of {', '.join(self._verbs)}, got {command.verb!r}")
            data = encode(ControlReply(True, "", self._handle(command)))
        except HDError as error:
            log.warning("command %s: %s", last_part(str(query.key_expr)), error)
            data = encode(ControlReply(False, str(error)[:1000], {}))
        except Exception as error:
            # Whoever commands a robot must hear that it failed, and not wait for an answer that never comes.
            log.exception("command %s failed", last_part(str(query.key_expr)))
            data = encode(ControlReply(False, f"it failed, see the log: {type(error).__name__}: {error}"[:1000], {}))
        query.reply(query.key_expr, data)


def request(
    session: zenoh.Session,
    run: str,
    verb: str,
    timeout: float = 5.0,
    arguments: Mapping[str, Any] | None = None,
    asked: str = "learner of the run",
) -> dict[str, Any]:
    """Send a command and return the state after it.

    Args:
        session: an open session.
        run: name of the run, or of the robot.
        verb: one of `VERBS`, or of `ROBOT_VERBS` for a robot; each may be repeated without harm.
        timeout: seconds.
        arguments: JSON object; see `ControlRequest`.
        asked: who is asked, for messages.

    Raises:
        BusError: when nobody answers in time, or the answer is an error.
        MessageError: when the answer is invalid.
    """
    data = encode(ControlRequest(verb, arguments or {}))
    for reply in ask_until_answered(session, Keys(run).control(verb), timeout, data):
        if reply.ok is None:
            continue
        answer = decode(reply.ok.payload.to_bytes(), ControlReply)
        if not answer.ok:
            raise BusError(f"the {asked} {run!r} refused {verb!r}: {answer.error}")
        return dict(answer.body)
    raise BusError(
        f"no {asked} {run!r} answered within {timeout:g} s: check that it runs and that the endpoint is right"
    )


def _read(query: zenoh.Query) -> ControlRequest:
    if query.payload is None or len(query.payload) > MAX_SMALL:
        raise MessageError("control_request", f"must have a payload of at most {MAX_SMALL} bytes")
    command = decode(query.payload.to_bytes(), ControlRequest)
    verb = last_part(str(query.key_expr))
    if command.verb != verb:
        raise MessageError("control_request.verb", f"must be {verb!r}, as in the key, got {command.verb!r}")
    return command
