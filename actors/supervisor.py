"""Starts, watches and restarts the processes of several actors."""

from __future__ import annotations

import logging
import re
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Sequence

from actors.options import ActorOptions
from actors.process import EXIT_UNUSABLE
from common.system.printable import printable
from common.system.reaper import Reaper
from common.system.runtime import process_environment, python_module
from common.system.signals import on_signals
from common.system.threads import guarded

log = logging.getLogger(__name__)

POLL_SECONDS = 0.1
STOP_SECONDS = 2.5
FIRST_PAUSE = 1.0
LONGEST_PAUSE = 60.0
# An actor that ran this long is healthy: its next crash counts as the first.
HEALTHY_SECONDS = 60.0
KEPT_LINES = 60
_LONGEST_ERROR = 250
# The time, level and logger of a line of an actor's log, and such a line that tells of no error.
_LOG_HEAD = re.compile(r"[0-9-]+ [0-9:,]+ [A-Z]+ +[\w.]+: ")
_ALL_WELL = re.compile(r"[0-9-]+ [0-9:,]+ (DEBUG|INFO) ")


class _Child:
    """One actor's process, what it said last, and when it may be started again."""

    def __init__(self, options: ActorOptions) -> None:
        self.options = options
        self.process: subprocess.Popen[str] | None = None
        self.crashes = 0
        self.due = 0.0
        self.started = 0.0
        self.lines: deque[str] = deque(maxlen=KEPT_LINES)

    def start(self, group: int) -> None:
        self.lines.clear()
        self.started = time.monotonic()
        self.process = subprocess.Popen(
            python_module("actors.process", self.options.model_dump_json()),
            env=process_environment(threads=1),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="replace",
            process_group=group,
        )
        forward = guarded(f"passing on the log of {self.options.name}", self._forward)
        threading.Thread(target=forward, args=(self.process,), daemon=True).start()

    def _forward(self, process: subprocess.Popen[str]) -> None:
        """Pass the actor's log on, line by line under its name, and keep the last lines."""
        assert process.stdout is not None
        for line in process.stdout:
            said = printable(line.rstrip())
            self.lines.append(said)
            sys.stderr.write(f"{self.options.name} | {said}\n")
            sys.stderr.flush()

    def last_error(self) -> str:
        """Return the last line that tells what went wrong: of a log, or the end of a traceback."""
        said = [line for line in self.lines if line.strip() and not _ALL_WELL.match(line)]
        return said[-1] if said else "it said nothing"


class Supervisor:
    """Keeps a number of actors running until it is told to stop.

    A crashed actor is started again after 1, 2, 4, ... at most 60 seconds; one that ended because of something that a
    user has to mend (exit code 3) ends all. Actors look after this process, and a `Reaper` after the actors, so they
    end with it within three seconds whatever happens.

    Args:
        actors: what each of them is told.
    """

    def __init__(self, actors: Sequence[ActorOptions]) -> None:
        self._children = [_Child(options) for options in actors]
        self._reaper = Reaper()
        self._stopping = 0

    def run(self) -> int:
        """Run until SIGINT or SIGTERM; return the exit code: 0 when told to stop, 1 when an actor is unusable."""
        with on_signals(self._on_signal, signal.SIGINT, signal.SIGTERM):
            try:
                return self._run()
            finally:
                self._stop_all()
                self._reaper.close()

    def _run(self) -> int:
        for child in self._children:
            child.start(self._reaper.group())
        while not self._stopping:
            if any(self._watch(child) for child in self._children):
                return 1
            if all(child.process is None and child.due == float("inf") for child in self._children):
                return 0
            time.sleep(POLL_SECONDS)
        log.info("stopping %d actors", len(self._children))
        return 0

    def _on_signal(self, number: signal.Signals) -> None:
        del number
        self._stopping += 1

    def _watch(self, child: _Child) -> bool:
        """Look after one actor; return True when there is no point in continuing."""
        now = time.monotonic()
        if child.process is None:
            if now >= child.due:
                child.start(self._reaper.group())
            return False
        code = child.process.poll()
        if code is None:
            return False
        ran = now - child.started
        child.process = None
        # Its last lines may still be on their way through the pipe.
        time.sleep(POLL_SECONDS)
        if code == EXIT_UNUSABLE:
            log.error("%s cannot work: %s", child.options.name, child.last_error())
            return True
        if code == 0:
            log.info("%s has finished", child.options.name)
            child.due = float("inf")
            return False
        child.crashes = 1 if ran >= HEALTHY_SECONDS else child.crashes + 1
        pause = min(FIRST_PAUSE * 2.0 ** (child.crashes - 1), LONGEST_PAUSE)
        child.due = now + pause
        how, why = _how_it_ended(code), child.last_error()
        log.error(
            "%s %s after %.0f s, starting it again in %.0f s. Its last error: %s",
            child.options.name,
            how,
            ran,
            pause,
            why,
        )
        # It tells the learner about its predecessor, which cannot any more.
        told = f"{how}: {_LOG_HEAD.sub('', why)}"[:_LONGEST_ERROR]
        again = {"restarts": child.options.restarts + 1, "last_error": told}
        child.options = child.options.model_copy(update=again)
        return False

    def _stop_all(self) -> None:
        """Ask all actors to stop; kill those that have not after 2.5 s, or at once on a second signal."""
        running = [child.process for child in self._children if child.process is not None]
        for process in running:
            process.terminate()
        deadline = time.monotonic() + STOP_SECONDS
        while any(process.poll() is None for process in running):
            if time.monotonic() >= deadline or self._stopping > 1:
                late = [process for process in running if process.poll() is None]
                log.warning("killing %d actors that did not stop in time", len(late))
                for process in late:
                    process.kill()
                break
            time.sleep(0.02)
        for process in running:
            process.wait()


def _how_it_ended(code: int) -> str:
    if code < 0:
        try:
            return f"was killed by {signal.Signals(-code).name}"
        except ValueError:
            return f"was killed by signal {-code}"
    return f"crashed (exit code {code})"
