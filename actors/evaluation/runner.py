"""Runs planners on worlds: in several processes, resumable, with one results file per planner."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from actors.evaluation.journal import Journal
from actors.evaluation.large.results import large_results
from actors.evaluation.outcome import Outcome
from actors.evaluation.pool import Job, WorkerPool
from actors.evaluation.results import Results, ResultsError, write_record, write_results
from actors.evaluation.settings import EvaluationSettings
from actors.evaluation.step_limit import warn_of_limit
from actors.evaluation.worker_process import WorkerProcesses
from actors.evaluation.worlds import WorldSet
from common.errors import ConfigError, LockedError
from common.ids import check_id
from common.system.closing import Closing
from common.system.code_state import code_state, commit_of
from common.system.file_lock import FileLock
from common.system.runtime import cores_left

log = logging.getLogger(__name__)

# Worlds that a warning about the step limit looks at, spread evenly over all.
_LOOKED_AT = 16


@dataclass(frozen=True, slots=True)
class Progress:
    """One finished episode, for whoever shows progress.

    Attributes:
        job: planner and world.
        map: name of the world.
        outcome: how it went.
    """

    job: Job
    map: str
    outcome: Outcome


class Evaluation(Closing):
    """All episodes of some planners on some worlds, in a folder.

    For each planner the folder holds `<planner>.json`, the results, and `<planner>.jsonl`, the journal that lets a
    broken-off run continue; until it is closed, no other evaluation of the same planners can use the folder. Episodes
    depend on the seed and on nothing else, so the number of processes changes nothing.

    Usage::

        with Evaluation(settings, ["greedy", "tare"], out) as evaluation:
            evaluation.run(jobs=4, watch=lambda progress: ...)
            for planner, outcomes in evaluation.crashes().items():
                ...

    """

    def __init__(
        self,
        settings: EvaluationSettings,
        planners: Sequence[str],
        out: Path,
        *,
        label: str | None = None,
        overwrite: bool = False,
        processes: WorkerProcesses | None = None,
    ) -> None:
        """Check everything that can be checked before the work starts, and read what was done already.

        Args:
            settings: what the episodes are.
            planners: their names, `omniscient` being the reference.
            out: folder of the results; made when missing.
            label: name of the only planner in the results, so that policies can be told apart; None for its own.
            overwrite: forget what was done already.
            processes: where worker processes come from, one prepared perhaps; whoever gives it closes it.

        Raises:
            HDError: a planner cannot be made, a map source cannot be used, the folder holds other results, or another
                evaluation of a planner is at work in it.
        """
        self._settings = settings
        self._planners = list(dict.fromkeys(planners))
        if not self._planners:
            raise ConfigError("no planner given: use --planner NAME[,NAME...], see 'hd-eval planners'")
        if label is not None:
            check_label(label, self._planners)
        self._label = label
        self._processes = processes
        for planner in self._planners:
            settings.make(planner)
        self._worlds = WorldSet.open(settings.maps, settings.map_task, settings.metres_per_pixel, settings.limit)
        self._commit = commit_of(code_state())
        self._out = out
        with ExitStack() as opened:
            try:
                out.mkdir(parents=True, exist_ok=True)
                for planner in self._planners:
                    opened.enter_context(self._lock(planner))
                if overwrite:
                    for planner in self._planners:
                        self._path(planner, "jsonl").unlink(missing_ok=True)
            except OSError as error:
                raise ResultsError(f"cannot use the folder {out} ({error.strerror}): choose another --out") from error
            written = [path.stat().st_mtime for name in self._planners if (path := self._path(name, "jsonl")).exists()]
            self._continued_from = min(written, default=None)
            self._journals = {
                planner: Journal.open(self._path(planner, "jsonl"), self._fingerprint(planner))
                for planner in self._planners
            }
            self._locks = opened.pop_all()

    def close(self) -> None:
        """Let others use the folder; safe to call twice."""
        self._locks.close()

    @property
    def worlds(self) -> int:
        """Number of worlds."""
        return len(self._worlds)

    def maps_warning(self) -> str:
        """Return a sentence where maps were written after results that are continued; else an empty one."""
        if self._continued_from is None or not any(self.done(planner) for planner in self._planners):
            return ""
        digests = [journal.digests for journal in self._journals.values()]
        changed = sorted({path for each in digests for path in self._worlds.changed_since(self._continued_from, each)})
        if not changed:
            return ""
        more = f" and {len(changed) - 1} more" if len(changed) > 1 else ""
        return (
            f"{changed[0]}{more} changed after results in {self._out} that are kept: if what is in the maps is another "
            "now, start over with --overwrite"
        )

    def limit_warning(self) -> str:
        """Return a sentence where the step limit is too small for what there is to explore; else an empty one."""
        settings = self._settings
        if settings.task.kind.needs_target:
            return ""
        numbers = self._worlds.numbers
        chosen = [numbers[i * len(numbers) // _LOOKED_AT] for i in range(_LOOKED_AT)] if numbers else []
        worlds = (self._worlds.load(number) for number in dict.fromkeys(chosen))
        return warn_of_limit(worlds, settings.task.max_steps, settings.mapping)

    def done(self, planner: str) -> int:
        """Return the number of worlds that a planner has finished."""
        outcomes = self._journals[planner].outcomes
        return sum(number in outcomes for number in self._worlds.numbers)

    def run(
        self,
        jobs: int,
        watch: Callable[[Progress], None] | None = None,
        warn: Callable[[str], None] | None = None,
    ) -> None:
        """Run all episodes that are missing; write results also when this is broken off.

        Args:
            jobs: processes; 0 for one per core.
            watch: called after each episode.
            warn: called with `limit_warning` where there is one; it is looked for while the processes start.

        Raises:
            HDError: the processes cannot start, or the results cannot be written.
        """
        waiting = [
            Job(planner, number)
            for planner in self._planners
            for number in self._worlds.numbers
            if number not in self._journals[planner].outcomes
        ]
        for planner, journal in self._journals.items():
            if journal.outcomes and journal.commits[-1:] != [self._commit]:
                made = ", ".join(journal.commits)
                log.warning("planner %s: %d episodes were run at commit %s", planner, self.done(planner), made)
        try:
            if waiting:
                self._work(waiting, min(jobs or cores_left(0), len(waiting)), watch, warn)
            elif warn is not None:
                self._warn(warn)
        finally:
            self._write()

    def crashes(self) -> dict[str, list[tuple[str, Outcome]]]:
        """Return the episodes that did not end by themselves: by planner, with the maps' names."""
        return self._outcomes(lambda outcome: outcome.crashed)

    def incomplete(self) -> dict[str, list[tuple[str, Outcome]]]:
        """Return the explorations that ended although reachable space is unseen: by planner, with the maps' names."""
        return self._outcomes(lambda outcome: outcome.unseen > 0.0 and not outcome.crashed)

    def _outcomes(self, chosen: Callable[[Outcome], bool]) -> dict[str, list[tuple[str, Outcome]]]:
        found = {
            planner: [
                (self._worlds.name(number), journal.outcomes[number])
                for number in self._worlds.numbers
                if number in journal.outcomes and chosen(journal.outcomes[number])
            ]
            for planner, journal in self._journals.items()
        }
        return {planner: outcomes for planner, outcomes in found.items() if outcomes}

    def results_file(self, planner: str) -> Path:
        """Return where a planner's results are."""
        return self._path(planner, "json")

    def _fingerprint(self, planner: str) -> dict[str, Any]:
        """Return what episodes depend on; with a label, the file's name no longer says whose they are."""
        found = self._settings.fingerprint(planner)
        return found if self._label is None else {**found, "planner": planner}

    def _lock(self, planner: str) -> FileLock:
        journal = self._path(planner, "jsonl")
        try:
            return FileLock(journal.with_name(f".{journal.stem}.lock"))
        except LockedError as error:
            raise ResultsError(
                f"another run (process {error.holder}) evaluates planner {planner!r} in {self._out}: wait "
                "until it ends, or choose another --out"
            ) from None

    def _warn(self, warn: Callable[[str], None]) -> None:
        if sentence := self.limit_warning():
            warn(sentence)

    def _work(
        self,
        waiting: Sequence[Job],
        workers: int,
        watch: Callable[[Progress], None] | None,
        warn: Callable[[str], None] | None,
    ) -> None:
        with (
            WorkerPool(self._settings, workers, self._processes) as pool,
            closing(pool.run(waiting)) as finished,
        ):
            if warn is not None:
                self._warn(warn)
            for job, outcome in finished:
                name = self._worlds.name(job.number)
                if outcome.crashed:
                    log.error("planner %s on %s: %s", job.planner, name, outcome.reason)
                self._journals[job.planner].add(job.number, outcome, self._commit, self._worlds.digest(job.number))
                if watch is not None:
                    watch(Progress(job, name, outcome))

    def _write(self) -> None:
        """Write the results of every planner that has any."""
        for planner, journal in self._journals.items():
            done = [(number, journal.outcomes[number]) for number in self._worlds.numbers if number in journal.outcomes]
            named = [(self._worlds.name(number), outcome) for number, outcome in done if outcome.waypoints]
            if named:
                self._write_results(planner, ", ".join(journal.commits), named)

    def _write_results(self, planner: str, commit: str, named: Sequence[tuple[str, Outcome]]) -> None:
        """Write the results file of a planner, from its outcomes with the names of their worlds."""
        settings = self._settings
        if settings.large:
            large = large_results(settings, planner, commit, self.worlds, named)
            large = large.model_copy(update={"planner": self._label or planner})
            write_record(self.results_file(planner), large, large.episodes)
            return
        results = Results(
            task=settings.task.kind.name,
            metres_per_pixel=self._worlds.metres_per_pixel,
            sensor_range_m=settings.mapping.sensor_range,
            planner=self._label or planner,
            commit=commit,
            seed=settings.seed,
            episodes=[outcome.result(name) for name, outcome in named],
        )
        write_results(self.results_file(planner), results)

    def _path(self, planner: str, suffix: str) -> Path:
        return self._out / f"{(self._label or planner).replace(':', '.')}.{suffix}"


def check_label(label: str, planners: Sequence[str]) -> None:
    """Raise ConfigError when a label cannot name the only planner in results."""
    if len(planners) != 1:
        raise ConfigError(
            f"--label names one planner, got {len(planners)} ({', '.join(planners)}): run them one by one"
        )
    try:
        check_id(label, "--label")
    except ValueError as error:
        raise ConfigError(str(error)) from None
