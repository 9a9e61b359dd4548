"""How the process of an actor is started and ended, wherever it runs."""

from __future__ import annotations

import logging
import re
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import Final, Protocol

from actors.options import ActorOptions
from common.system.kernel_folders import forget_old_caches, is_prepared, note_prepared
from common.system.printable import printable
from common.system.reaper import Reaper
from common.system.runtime import process_environment, python_module
from common.system.threads import guarded

log = logging.getLogger(__name__)

KEPT_LINES: Final = 60
# A process's last lines may still be on their way through the pipe when it has ended, seconds.
LAST_LINES: Final = 0.1
# A line of an actor's log that tells of no error.
_ALL_WELL: Final = re.compile(r"[0-9-]+ [0-9:,]+ (DEBUG|INFO) ")


@dataclass(frozen=True, slots=True)
class Ended:
    """How an actor's process ended.

    Attributes:
        code: its exit code, see `actors.process`; negative for the signal that killed it.
        how: the same in words.
        error: the last line in which it told what went wrong.
        seconds: how long it ran.
    """

    code: int
    how: str
    error: str
    seconds: float


class Running(Protocol):
    """An actor that was started."""

    def ended(self) -> Ended | None:
        """Return how it ended, None while it runs or waits for its place."""
        ...

    def terminate(self) -> None:
        """Ask it to stop."""
        ...

    def kill(self) -> None:
        """End it at once."""
        ...


def compile_kernels(network: str | None) -> None:
    """Compile the kernels in one process, before several actors start, unless that was done before.

    A fresh install takes a minute for it.

    Args:
        network: the run's `NetworkConfig` as JSON, None if it is not known yet.
    """
    use = str(network)
    if is_prepared("actors", use):
        forget_old_caches()
        return
    log.info("preparing the kernels")
    with Reaper() as reaper:
        subprocess.run(
            python_module("actors.warmup", *([] if network is None else [network])),
            env=process_environment(threads=1),
            check=True,
            process_group=reaper.group(),
        )
    note_prepared("actors", use)


class Launcher(Protocol):
    """Starts actors; closed when all of them have ended."""

    def start(self, options: ActorOptions) -> Running:
        """Start an actor."""
        ...

    def close(self) -> None:
        """Give back what it holds."""
        ...


class LocalLauncher:
    """Starts actors as processes of this machine.

    They look after the process that started them, and a `Reaper` after them, so they end with it within three seconds
    whatever happens.
    """

    def __init__(self) -> None:
        self._reaper = Reaper()

    def start(self, options: ActorOptions) -> Running:
        """Start an actor, whose log goes to the standard error line by line under its name."""
        return _LocalProcess(options, self._reaper.group())

    def close(self) -> None:
        """End the reaper."""
        self._reaper.close()


class _LocalProcess:
    """An actor's process, and what it said last."""

    def __init__(self, options: ActorOptions, group: int) -> None:
        self._name = options.name
        self._lines: deque[str] = deque(maxlen=KEPT_LINES)
        self._started = time.monotonic()
        self._process = subprocess.Popen(
            python_module("actors.process", options.model_dump_json()),
            env=process_environment(threads=1),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="replace",
            process_group=group,
        )
        forward = guarded(f"passing on the log of {options.name}", self._forward)
        self._reader = threading.Thread(target=forward, daemon=True)
        self._reader.start()

    def ended(self) -> Ended | None:
        code = self._process.poll()
        if code is None:
            return None
        seconds = time.monotonic() - self._started
        self._reader.join(LAST_LINES)
        return Ended(code, _how_it_ended(code), self._last_error(), seconds)

    def terminate(self) -> None:
        self._process.terminate()

    def kill(self) -> None:
        self._process.kill()

    def _forward(self) -> None:
        """Pass the actor's log on, and keep the last lines."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            said = printable(line.rstrip())
            self._lines.append(said)
            sys.stderr.write(f"{self._name} | {said}\n")
            sys.stderr.flush()

    def _last_error(self) -> str:
        """Return the last line that tells what went wrong: of a log, or the end of a traceback."""
        said = [line for line in list(self._lines) if line.strip() and not _ALL_WELL.match(line)]
        return said[-1] if said else "it said nothing"


def _how_it_ended(code: int) -> str:
    if code < 0:
        try:
            return f"was killed by {signal.Signals(-code).name}"
        except ValueError:
            return f"was killed by signal {-code}"
    return f"crashed (exit code {code})"
