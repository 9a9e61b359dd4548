"""Watches several actors and starts again those that crash."""

from __future__ import annotations

import logging
import re
import signal
import time
from collections.abc import Callable, Sequence
from typing import Final

from actors.launching import Ended, Launcher, Running
from actors.options import ActorOptions
from actors.process import EXIT_UNUSABLE
from common.system.signals import on_signals

log = logging.getLogger(__name__)

POLL_SECONDS: Final = 0.1
STOP_SECONDS: Final = 2.5
FIRST_PAUSE: Final = 1.0
LONGEST_PAUSE: Final = 60.0
# An actor that ran this long is healthy: its next crash counts as the first.
HEALTHY_SECONDS: Final = 60.0
_LONGEST_ERROR: Final = 250
# The time, level and logger of a line of an actor's log.
_LOG_HEAD: Final = re.compile(r"[0-9-]+ [0-9:,]+ [A-Z]+ +[\w.]+: ")


class _Charge:
    """An actor, and when it may be started again."""

    def __init__(self, options: ActorOptions) -> None:
        self.options = options
        self.running: Running | None = None
        self.crashes = 0
        self.due = 0.0


class Supervisor:
    """Keeps a number of actors running until it is told to stop.

    A crashed actor is started again after 1, 2, 4, ... at most 60 seconds; one that ended because of something that a
    user has to mend (exit code 3) ends all.

    Args:
        actors: what each of them is told.
        launcher: starts them; the caller closes it.
    """

    def __init__(self, actors: Sequence[ActorOptions], launcher: Launcher) -> None:
        self._charges = [_Charge(options) for options in actors]
        self._launcher = launcher
        self._stopping = 0

    def run(self) -> int:
        """Run until SIGINT or SIGTERM; return the exit code: 0 when told to stop, 1 when an actor is unusable."""
        with on_signals(self._on_signal, signal.SIGINT, signal.SIGTERM):
            try:
                return self._run()
            finally:
                self._stop_all()

    def _run(self) -> int:
        while not self._stopping:
            if any(self._watch(charge) for charge in self._charges):
                return 1
            if all(charge.running is None and charge.due == float("inf") for charge in self._charges):
                return 0
            time.sleep(POLL_SECONDS)
        log.info("stopping %d actors", len(self._charges))
        return 0

    def _on_signal(self, number: signal.Signals) -> None:
        del number
        self._stopping += 1

    def _watch(self, charge: _Charge) -> bool:
        """Look after one actor; return True when there is no point in continuing."""
        if charge.running is None:
            if time.monotonic() >= charge.due:
                charge.running = self._launcher.start(charge.options)
            return False
        end = charge.running.ended()
        if end is None:
            return False
        charge.running = None
        if end.code == EXIT_UNUSABLE:
            log.error("%s cannot work: %s", charge.options.name, end.error)
            return True
        if end.code == 0:
            log.info("%s has finished", charge.options.name)
            charge.due = float("inf")
            return False
        self._plan_restart(charge, end)
        return False

    def _plan_restart(self, charge: _Charge, end: Ended) -> None:
        charge.crashes = 1 if end.seconds >= HEALTHY_SECONDS else charge.crashes + 1
        pause = min(FIRST_PAUSE * 2.0 ** (charge.crashes - 1), LONGEST_PAUSE)
        charge.due = time.monotonic() + pause
        log.error(
            "%s %s after %.0f s, starting it again in %.0f s. Its last error: %s",
            charge.options.name,
            end.how,
            end.seconds,
            pause,
            end.error,
        )
        # It tells the learner about its predecessor, which cannot any more.
        told = f"{end.how}: {_LOG_HEAD.sub('', end.error)}"[:_LONGEST_ERROR]
        again = {"restarts": charge.options.restarts + 1, "last_error": told}
        charge.options = charge.options.model_copy(update=again)

    def _stop_all(self) -> None:
        """Ask all actors to stop; kill those that have not after 2.5 s, or at once on a second signal."""
        running = [charge.running for charge in self._charges if charge.running is not None]
        for each in running:
            each.terminate()
        running = _wait(running, STOP_SECONDS, lambda: self._stopping > 1)
        if running:
            log.warning("killing %d actors that did not stop in time", len(running))
            for each in running:
                each.kill()
            _wait(running, STOP_SECONDS)


def _wait(running: list[Running], seconds: float, enough: Callable[[], bool] = lambda: False) -> list[Running]:
    """Return those that have not ended after so many seconds, or when it was enough."""
    deadline = time.monotonic() + seconds
    while running := [each for each in running if each.ended() is None]:
        if time.monotonic() >= deadline or enough():
            break
        time.sleep(0.02)
    return running
