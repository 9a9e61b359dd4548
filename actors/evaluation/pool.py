"""The worker processes of an evaluation: start, feed, watch, replace."""

from __future__ import annotations

import json
import logging
import queue
import subprocess
import threading
import time
from collections import deque
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Any, Self

from actors.evaluation.outcome import Outcome, Place, crashed
from actors.evaluation.settings import EvaluationSettings
from actors.evaluation.worker_process import WorkerProcesses
from common.errors import HDError
from common.system.threads import guarded

log = logging.getLogger(__name__)

POLL_SECONDS = 0.2
STOP_SECONDS = 2.0
# A planner's first decisions in a worker compile its kernels, which takes a minute or two on a fresh install.
WARM_UP_SECONDS = 600.0


@dataclass(frozen=True, slots=True)
class Job:
    """One episode.

    Attributes:
        planner: name.
        number: of the world.
    """

    planner: str
    number: int


def patience(time_limit: float) -> float:
    """Return the seconds after which a decision counts as endless.

    Far above the limit, which a worker checks itself in processor time: another load of the machine must not decide.
    """
    return 10.0 * time_limit + 10.0


class _Worker:
    """One process, its present job, and how far that has come."""

    def __init__(
        self,
        time_limit: float,
        events: queue.Queue[tuple[_Worker, dict[str, Any] | None]],
        process: subprocess.Popen[str],
    ) -> None:
        self.ready = False
        self.job: Job | None = None
        self.places: list[Place] = []
        self.due: float | None = None
        self.killed_for = ""
        self._patience = patience(time_limit)
        self._events = events
        self.process = process
        listen = guarded("listening to an evaluating process", self._listen)
        threading.Thread(target=listen, daemon=True).start()

    def give(self, job: Job) -> None:
        """Hand out a job."""
        self.job, self.places, self.due = job, [], None
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(json.dumps({"planner": job.planner, "number": job.number}) + "\n")
            self.process.stdin.flush()
        except BrokenPipeError:
            # Its end is told by the thread that listens.
            log.debug("worker %d is gone before its job", self.process.pid)

    def note(self, event: str, value: Any) -> None:
        """Take in an event of the present job."""
        seconds = {"warm": WARM_UP_SECONDS, "decide": self._patience}.get(event)
        self.due = None if seconds is None else time.monotonic() + seconds
        if event in ("start", "moved"):
            self.places.append(Place(*value))

    def stop(self) -> None:
        """End the process: at once when it works, else by closing its input."""
        if self.job is not None or not self.ready:
            self.process.terminate()
        self._close_input()
        try:
            self.process.wait(STOP_SECONDS)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def bury(self) -> int:
        """Release what is left of a process that has ended; return its exit code."""
        self._close_input()
        return self.process.wait()

    def _close_input(self) -> None:
        if self.process.stdin is not None:
            try:
                self.process.stdin.close()
            except BrokenPipeError:
                log.debug("worker %d was gone already", self.process.pid)

    def _listen(self) -> None:
        assert self.process.stdout is not None
        try:
            with self.process.stdout as lines:
                for line in lines:
                    self._events.put((self, json.loads(line)))
        finally:
            self._events.put((self, None))


# What workers tell, each line with the worker that it came from; None when its process has ended.
_Events = queue.Queue[tuple[_Worker, dict[str, Any] | None]]


class WorkerPool:
    """Runs jobs in several processes, each of which can be lost without loss of the others' work.

    A worker whose planner does not come back from a decision is ended, and so its episode; one that crashes costs its
    episode too; in both cases another worker takes its place.

    The first one starts when the pool is entered, so that it prepares itself while there is something else to do.

    Usage::

        with WorkerPool(settings, workers=4) as pool:
            for job, outcome in pool.run(jobs):
                ...
    """

    def __init__(self, settings: EvaluationSettings, workers: int, processes: WorkerProcesses | None = None) -> None:
        """Set up.

        Args:
            settings: handed to every worker.
            workers: number of processes.
            processes: where they come from, one prepared perhaps; whoever gives it closes it.
        """
        self._settings = settings
        self._count = workers
        self._events: _Events = queue.Queue()
        self._workers: list[_Worker] = []
        self._own_processes = processes is None
        self._processes = WorkerProcesses() if processes is None else processes

    def __enter__(self) -> Self:
        # One first: on a fresh install it compiles for a minute, and all of them would do so at the same time.
        self._start()
        return self

    def __exit__(self, *error: object) -> None:
        for worker in self._workers:
            worker.stop()
        self._workers.clear()
        if self._own_processes:
            self._processes.close()

    def run(self, jobs: Sequence[Job]) -> Generator[tuple[Job, Outcome], None, None]:
        """Yield each job with its outcome, in the order in which they end.

        Raises:
            HDError: workers cannot start.
        """
        waiting = deque(jobs)
        left = len(waiting)
        while left:
            try:
                worker, message = self._events.get(timeout=POLL_SECONDS)
            except queue.Empty:
                self._end_overdue()
                continue
            if message is None:
                job, outcome = self._lost(worker)
                if job is not None and outcome is not None:
                    left -= 1
                    yield job, outcome
                if waiting:
                    self._start()
                continue
            event, value = message["event"], message["value"]
            if event == "unusable":
                raise HDError(value)
            if event == "ready":
                worker.ready = True
                while len(self._workers) < min(self._count, left):
                    self._start()
            elif event == "done":
                done, worker.job = worker.job, None
                assert done is not None
                left -= 1
                value["waypoints"] = [(x, y) for x, y in value["waypoints"]]
                yield done, Outcome(**value)
            else:
                worker.note(event, value)
            if worker.ready and worker.job is None and waiting:
                worker.give(waiting.popleft())

    def _start(self) -> None:
        process = self._processes.start(self._settings.model_dump_json())
        self._workers.append(_Worker(self._settings.time_limit, self._events, process))

    def _end_overdue(self) -> None:
        """End workers whose planner does not come back to say itself that it took too long."""
        for worker in self._workers:
            if worker.due is not None and time.monotonic() > worker.due:
                limit = self._settings.time_limit
                worker.killed_for = f"a decision did not end, the limit is {limit:g} s: its process was killed"
                worker.process.kill()
                worker.due = None

    def _lost(self, worker: _Worker) -> tuple[Job | None, Outcome | None]:
        """Count a worker's end; return the job that it takes with it."""
        code = worker.bury()
        self._workers.remove(worker)
        if not worker.ready:
            raise HDError(f"the worker processes cannot start (exit code {code}): see their last lines above")
        if worker.job is None:
            return None, None
        reason = worker.killed_for or f"its process ended with exit code {code}"
        return worker.job, crashed(worker.places, reason)
