"""Commands to robots of which several may answer: who is there, and what each of them says."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import zenoh

from common.bus.keys import ALL_BRIDGES, Keys, process_of, run_of
from common.bus.query import RETRY_SECONDS, ask
from common.errors import BusError, MessageError
from common.messages.replies import ControlReply, ControlRequest
from common.messages.schema import decode, encode

BridgeId = tuple[str, str]
"""(name, instance) of a bridge: the name of its robot, and that of its process."""

# Peers that find each other by gossip may show up so much later than the first one, seconds.
SETTLE: Final = 0.7
_ROUND: Final = 1.0


@dataclass(slots=True)
class Answers:
    """What the bridges said that a command went to.

    Attributes:
        states: state after the command, by bridge.
        refusals: why a bridge refused, one text for each answer that was no state.
        missing: bridges that are there, and did not answer in time.
    """

    states: dict[BridgeId, dict[str, Any]] = field(default_factory=dict)
    refusals: list[str] = field(default_factory=list)
    missing: frozenset[BridgeId] = frozenset()

    def problems(self, timeout: float) -> list[str]:
        """Return why not every bridge that is there has obeyed within ``timeout`` seconds; empty when each one has."""
        return [
            *self.refusals,
            *(
                f"robot {name!r} did not answer within {timeout:g} s (instance {instance}): it may still be moving"
                for name, instance in sorted(self.missing)
            ),
        ]


def bridges_at(session: zenoh.Session, name: str | None = None, timeout: float = 1.0) -> frozenset[BridgeId]:
    """Return the bridges that are there now, asking once: those of one name, or all of them."""
    selector = ALL_BRIDGES if name is None else Keys(name).live("bridge", "x").removesuffix("x") + "*"
    found = set()
    for reply in session.liveliness().get(selector, timeout=timeout):
        if reply.ok is not None:
            key = str(reply.ok.key_expr)
            with contextlib.suppress(BusError):  # no bridge has such a name
                found.add((run_of(key), process_of(key)[1]))
    return frozenset(found)


def command_all(
    session: zenoh.Session,
    name: str | None,
    verb: str,
    timeout: float = 5.0,
    arguments: Mapping[str, Any] | None = None,
) -> Answers:
    """Send a command to every bridge of a name, or of any, and wait for each of them.

    It is sent at once to whoever is known, and again to all until everybody has answered that shows up.

    Args:
        session: an open session.
        name: of the robot; None for every robot on the network.
        verb: one of `ROBOT_VERBS` that may be repeated without harm.
        timeout: seconds until those that have not answered count as missing.
        arguments: JSON object; see `ControlRequest`.
    """
    data = encode(ControlRequest(verb, arguments or {}))
    answers = Answers()
    seen: set[BridgeId] = set()
    refused: set[str] = set()
    began = time.monotonic()
    while True:
        left = began + timeout - time.monotonic()
        found = bridges_at(session, name, min(_ROUND, max(left, 0.1)))
        seen |= found
        for each in sorted({name} if name is not None else {robot for robot, _ in seen - answers.states.keys()}):
            for reply in ask(session, Keys(each).control(verb), min(_ROUND, max(left, 0.1)), data, everybody=True):
                _note(reply, each, answers, refused)
        answers.refusals = sorted(refused)
        # Also those that have gone meanwhile: nobody knows whether they obeyed.
        answers.missing = frozenset(seen - answers.states.keys())
        elapsed = time.monotonic() - began
        everybody = bool(answers.states or refused) and not answers.missing and elapsed >= SETTLE
        if everybody or elapsed >= timeout:
            return answers
        time.sleep(min(RETRY_SECONDS, max(0.0, began + timeout - time.monotonic())))


def _note(reply: zenoh.Reply, name: str, answers: Answers, refused: set[str]) -> None:
    if reply.ok is None:
        return
    try:
        answer = decode(reply.ok.payload.to_bytes(), ControlReply)
    except MessageError as error:
        refused.add(f"robot {name!r} answered what cannot be read: {error}")
        return
    if answer.ok:
        body = dict(answer.body)
        answers.states[name, str(body.get("instance", ""))] = body
    else:
        refused.add(f"robot {name!r}: {answer.error}")
