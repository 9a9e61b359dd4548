"""Starts the worker processes of an evaluation, the first one before it is known what it is to run.

Importing takes a second, in the process of a command as in that of a worker. This module imports little, so that a
command starts a worker first, and both import at the same time.
"""

from __future__ import annotations

import logging
import subprocess

from common.system.closing import Closing
from common.system.reaper import Reaper
from common.system.runtime import process_environment, python_module

log = logging.getLogger(__name__)

WORKER = "actors.evaluation.worker"


class WorkerProcesses(Closing):
    """Starts processes that take settings, and then jobs, on standard input (`actors.evaluation.worker`).

    When this process is killed, they end too. Those that were handed out are ended by whoever has them.

    Usage::

        with WorkerProcesses() as processes:
            processes.prepare()
            settings = resolve(...)  # imports while the process does
            process = processes.start(settings.model_dump_json())
    """

    def __init__(self) -> None:
        self._reaper = Reaper()
        self._prepared: subprocess.Popen[str] | None = None

    def prepare(self) -> None:
        """Start one process that imports, and waits for its settings."""
        self._prepared = self._popen()

    def start(self, settings: str) -> subprocess.Popen[str]:
        """Return a process that was told its settings: the prepared one, if it is there.

        Args:
            settings: of the evaluation, JSON in one line.
        """
        process, self._prepared = self._prepared, None
        if process is None:
            process = self._popen()
        assert process.stdin is not None
        try:
            process.stdin.write(f"{settings}\n")
            process.stdin.flush()
        except BrokenPipeError:
            # Whoever listens to it sees its end.
            log.debug("worker %d was gone before its settings", process.pid)
        return process

    def close(self) -> None:
        """End a process that was prepared in vain and the watch over those handed out; safe to call twice."""
        process, self._prepared = self._prepared, None
        if process is not None:
            with process:
                process.kill()
        self._reaper.close()

    def _popen(self) -> subprocess.Popen[str]:
        return subprocess.Popen(
            python_module(WORKER),
            env=process_environment(threads=1),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            encoding="utf-8",
            # Ctrl-C is for this process alone, which then stops its workers; when it is killed, its reaper does.
            process_group=self._reaper.group(),
        )
