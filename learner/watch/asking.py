"""Asking a running learner over the bus: commands, each answered with its status."""

from __future__ import annotations

import zenoh

from common.bus.control import request
from common.bus.spec import list_runs
from common.errors import BusError, MessageError
from learner.watch.status import LearnerStatus


def ask_learner(session: zenoh.Session, run: str, verb: str, timeout: float) -> LearnerStatus:
    """Send a command to the learner of a run and return its status after it.

    Args:
        session: an open session.
        run: name of the run.
        verb: one of `VERBS`. With ``status`` all actors come, page by page; with others those of the first page.
        timeout: seconds for each page.

    Raises:
        BusError: nobody answers in time, or the command is refused.
        MessageError: the answer is from another release.
    """
    body = request(session, run, verb, timeout)
    actors, last = list(body.get("actors", [])), ""
    while verb == "status" and (after := body.get("next")) and after > last:
        # A learner with thousands of actors tells of them page by page.
        last = after
        body = request(session, run, verb, timeout, {"after": after})
        actors += body.get("actors", [])
    body["actors"] = actors
    try:
        return LearnerStatus.from_json(body)
    except (KeyError, TypeError) as error:
        raise MessageError("control_reply.body", f"is from another release ({error}): install the same one") from None


def only_run(session: zenoh.Session, timeout: float) -> str:
    """Return the name of the one run on the bus.

    Raises:
        BusError: there is none in time, or there are several.
    """
    specs = list_runs(session, timeout)
    if not specs:
        raise BusError("no learner answers: check that one is running, and give its endpoint with --connect")
    if len(specs) > 1:
        raise BusError(f"several runs are live, choose one with --run: {', '.join(spec.run for spec in specs)}")
    return specs[0].run
