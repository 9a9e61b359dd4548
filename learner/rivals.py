"""Other learners of the same run that come into sight while both already work, because their networks were joined."""

from __future__ import annotations

import logging
import time
from collections.abc import Collection

import zenoh

from common.bus.liveness import Process, declare_presence
from common.system.closing import Closing

logger = logging.getLogger(__name__)

_PREFIX = "since-"


class Rivals(Closing):
    """Shows since when this learner works, and tells whether an earlier one of the run is there.

    All learners that see each other compare the same texts, so exactly one of them continues.

    Args:
        session: of this learner.
        run: name of the run.
        learner: incarnation of this learner; decides between two of the same millisecond.
        began: when it began, seconds since 1970.
    """

    def __init__(self, session: zenoh.Session, run: str, learner: int, began: float) -> None:
        self._run = run
        self._name = f"{_PREFIX}{round(1e3 * began):014d}-{learner}"
        self._others: frozenset[str] = frozenset()
        self._token = declare_presence(session, run, "learner", self._name)

    def earlier(self, present: Collection[Process]) -> bool:
        """Whether an earlier learner is among the processes that are present; the log says what changed."""
        others = frozenset(
            name for role, name in present if role == "learner" and name.startswith(_PREFIX) and name != self._name
        )
        holds, held = _any_before(others, self._name), _any_before(self._others, self._name)
        if others - self._others:
            logger.error(
                "another learner of run %s works on this network since %s. %s: stop one, or give it another --run",
                self._run,
                ", ".join(map(_moment, sorted(others))),
                "This one began later, so it holds and takes nothing" if holds else "It began later, so it has to hold",
            )
        elif self._others - others:
            logger.info("the other learner of run %s is gone%s", self._run, "" if not held or holds else ": continuing")
        self._others = others
        return holds

    def close(self) -> None:
        """Take the sign off the bus; safe to call twice."""
        self._token.undeclare()


def _any_before(others: Collection[str], name: str) -> bool:
    return any(other < name for other in others)


def _moment(name: str) -> str:
    digits = name.removeprefix(_PREFIX).partition("-")[0]
    return time.strftime("%H:%M:%S", time.localtime(int(digits) / 1e3)) if digits.isdigit() else name
