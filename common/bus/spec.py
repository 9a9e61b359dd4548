"""The run's specification: an actor needs only an endpoint and the name of the run."""

from __future__ import annotations

import logging

import zenoh

from common.bus.keys import ALL_SPECS, Keys
from common.bus.query import QueryServer, ask, ask_until_answered
from common.errors import BusError, MessageError
from common.messages.replies import Spec
from common.messages.schema import decode, encode

log = logging.getLogger(__name__)


class SpecServer(QueryServer):
    """Answers with the run's specification.

    Usage::

        with SpecServer(session, Spec("run", incarnation, config.model_dump_json())):
            ...
    """

    def __init__(self, session: zenoh.Session, spec: Spec) -> None:
        # The key is given outright: a question for all runs (hd/*/spec) is answered on this run's own key.
        key, data = Keys(spec.run).spec, encode(spec)
        super().__init__(session, key, lambda query: query.reply(key, data))


def fetch_spec(session: zenoh.Session, run: str, timeout: float) -> Spec:
    """Return the specification of a run, waiting for its learner.

    Raises:
        BusError: when no learner answers within ``timeout`` seconds.
        MessageError: when the answer is invalid, for example of another protocol version.
    """
    for reply in ask_until_answered(session, Keys(run).spec, timeout):
        if reply.ok is not None:
            spec = decode(reply.ok.payload.to_bytes(), Spec)
            if spec.run != run:
                raise MessageError("spec.run", f"must be {run!r}, got {spec.run!r}")
            return spec
    raise BusError(
        f"no learner of the run {run!r} answered within {timeout:g} s: check that 'hd-learner start --run {run}' is "
        "running and that the endpoint is right"
    )


def specs_of(session: zenoh.Session, run: str, timeout: float) -> list[Spec]:
    """Return the specifications of all learners of one run that answer now, asking once; there should be one."""
    found = []
    for reply in ask(session, Keys(run).spec, timeout, everybody=True):
        if reply.ok is not None:
            found.append(decode(reply.ok.payload.to_bytes(), Spec))
    return found


def list_runs(session: zenoh.Session, timeout: float = 2.0) -> list[Spec]:
    """Return the specifications of all runs on the bus, sorted by name; empty when there is none in time.

    Raises:
        MessageError: all that answer are of another release.
    """
    found: dict[str, Spec] = {}
    strange: dict[str, MessageError] = {}
    for reply in ask_until_answered(session, ALL_SPECS, timeout, everybody=True):
        if reply.ok is None:
            continue
        try:
            spec = decode(reply.ok.payload.to_bytes(), Spec)
        except MessageError as error:
            strange[str(reply.ok.key_expr)] = error
            continue
        found[spec.run] = spec
    if strange and not found:
        raise next(iter(strange.values()))
    for key, problem in strange.items():
        log.warning("skipped the run at %s: %s", key, problem)
    return [found[name] for name in sorted(found)]
