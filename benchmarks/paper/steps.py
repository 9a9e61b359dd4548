"""The steps of the work: each a command in a process of its own, done once, and continued where it was broken off."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from actors.evaluation.packing import SUFFIXES
from actors.evaluation.results import write_packed
from benchmarks.paper import curves
from benchmarks.paper.plan import MAPS, SCENES, UPDATES, Place, Row, Table, Training
from common.errors import HDError
from common.system.documents import read_json

COSTS: Final = "costs.json"


class StepError(HDError):
    """A step failed; what was done before it stays."""


@dataclass(frozen=True, slots=True)
class Cost:
    """What a step took, summed over the times that it was continued.

    Attributes:
        core_hours: processor time of its processes.
        hours: of wall time.
    """

    core_hours: float = 0.0
    hours: float = 0.0


@dataclass(frozen=True, slots=True)
class Folders:
    """Where things are.

    Attributes:
        maps: public maps.
        work: what is under way: runs, journals, scenes, logs.
        release: what is kept: packed results, policies, costs.
    """

    maps: Path
    work: Path
    release: Path

    def filled(self, options: Sequence[str]) -> list[str]:
        """Return options with the folders in them; scenes as from `work`, so that results name no machine's."""
        return [option.replace(MAPS, str(self.maps)).replace(SCENES, "scenes") for option in options]

    def policy(self, training: str, seed: int) -> Path:
        """Return where the policy of a training is kept."""
        return self.release / "policies" / f"{training}-{seed}.safetensors"

    def point(self, training: str, seed: int, updates: int) -> Path:
        """Return where a point of the learning curve of a training is kept."""
        return self.release / "curves" / f"{training}-{seed}" / f"{curves.label(updates)}{SUFFIXES[0]}"

    def run(self, training: str, seed: int) -> Path:
        """Return the folder of a training's run."""
        return self.work / "runs" / f"{training}-{seed}"

    def packed(self, table: Table, row: Row) -> Path:
        """Return where the results of a row are kept."""
        suffix = ".json" if table.kind == "demo" else SUFFIXES[0]
        return self.release / table.name / f"{row.label}{suffix}"

    def done(self, training: tuple[Training, int] | None, places: Sequence[Place]) -> bool:
        """Return whether the policy of a training, if one is needed, and the results of rows are kept."""
        trained = training is None or self.policy(training[0].name, training[1]).exists()
        return trained and all(self.packed(place.table, place.row).exists() for place in places)

    def points_left(self, training: Training, seed: int) -> dict[int, str]:
        """Return the checkpoints of which points of a learning curve can be made, by updates.

        There are none before the policy is kept, and where the run is gone.
        """
        if not self.policy(training.name, seed).exists():
            return {}
        run = self.run(training.name, seed)
        near = {at: curves.checkpoint_at(run, at) for at in curves.AT}
        return {
            at: name
            for at, name in near.items()
            if name is not None and not self.point(training.name, seed, at).exists()
        }

    def updates(self, training: str, seed: int) -> int:
        """Return how many updates a training has made, 0 before it began."""
        summary = self.run(training, seed) / "summary.json"
        if self.policy(training, seed).exists():
            return UPDATES
        return int(read_json(summary)["updates"]) if summary.exists() else 0


def read_costs(folders: Folders) -> dict[str, Cost]:
    """Return what the steps took so far, by name."""
    path = folders.release / COSTS
    if not path.exists():
        return {}
    return {name: Cost(**values) for name, values in read_json(path).items()}


class Steps:
    """Carries out steps, several at once if threads ask for it.

    Attributes:
        stopped: set when they were asked to stop.

    Usage::

        steps = Steps(folders)
        steps.train(training, seed)
        steps.evaluate(place)
    """

    def __init__(self, folders: Folders) -> None:
        """Keep everything in these folders."""
        self._folders = folders
        self._lock = threading.Lock()
        self._running: set[subprocess.Popen[bytes]] = set()
        self.stopped = threading.Event()

    def stop(self) -> None:
        """End the processes in good order, so that their steps can be continued; those that would follow fail."""
        self.stopped.set()
        with self._lock:
            for process in self._running:
                process.terminate()

    def train(self, training: Training, seed: int) -> None:
        """Train a policy, or continue, and keep it; nothing to do when it is kept already.

        Raises:
            StepError: it failed, or was stopped.
        """
        folders = self._folders
        policy = folders.policy(training.name, seed)
        if policy.exists():
            return
        run = folders.run(training.name, seed)
        place = ["--runs", str(run.parent), "--run", run.name]
        if (run / "run.json").exists():
            options = ["resume", "--serial", *place]
        else:
            options = ["start", "--serial", *place, *folders.filled(training.options(seed))]
        self._carry_out(["learner", *options], run.name)
        if folders.updates(training.name, seed) < UPDATES:
            raise StepError(f"the training {run.name} ended early: see {self._log(run.name)}")
        self._export(run, "last", policy, run.name)

    def draw_curve(self, training: Training, seed: int) -> None:
        """Drive the checkpoints of a training, or continue; nothing to do where that is kept, or the run is gone.

        Raises:
            StepError: it failed, or was stopped.
        """
        folders = self._folders
        run = folders.run(training.name, seed)
        out = folders.work / "curves" / run.name
        for at, checkpoint in folders.points_left(training, seed).items():
            policy = out / f"{checkpoint}.safetensors"
            self._export(run, checkpoint, policy, f"curve-{run.name}")
            drive = ["actors.evaluation", "run", "--planner", "hdplanner", "--policy", str(policy), "--jobs", "1"]
            where = ["--label", curves.label(at), "--out", str(out), *folders.filled(curves.options(training.task))]
            self._carry_out([*drive, *where], f"curve-{run.name}")
            write_packed(out / f"{curves.label(at)}.json", folders.point(training.name, seed, at))

    def evaluate(self, place: Place) -> None:
        """Run a row of a table, or continue, and keep its results; nothing to do when they are kept already.

        Raises:
            StepError: it failed, or was stopped.
        """
        table, row, folders = place.table, place.row, self._folders
        packed = folders.packed(table, row)
        if packed.exists():
            return
        name, out = f"{table.name}-{row.label}", folders.work / table.name
        options = folders.filled(table.options)
        if table.kind == "demo":
            verdict = out / row.label / "verdict.json"
            verdict.unlink(missing_ok=True)
            # An exploration that does not end well is a result too.
            command = ["deploy", "demo", "--planner", row.planner, "--folder", str(verdict.parent), *options]
            self._carry_out(command, name, good=(0, 1))
            if not verdict.exists():
                raise StepError(f"{name} left no verdict: see {self._log(name)}")
            packed.parent.mkdir(parents=True, exist_ok=True)
            packed.write_bytes(verdict.read_bytes())
            return
        own = [] if row.label == row.planner else ["--label", row.label]
        if row.training is not None:
            own += ["--policy", str(folders.policy(row.training, row.seed))]
        command = ["actors.evaluation", table.kind, "--planner", row.planner, *own, "--jobs", "1"]
        self._carry_out([*command, "--out", str(out), *options], name)
        write_packed(out / f"{row.label}.json", packed)

    def _export(self, run: Path, which: str, policy: Path, name: str) -> None:
        """Write the policy of a run's checkpoint, as part of the step of this name."""
        policy.parent.mkdir(parents=True, exist_ok=True)
        place = ["--runs", str(run.parent), "--run", run.name, "--which", which, "--out", str(policy)]
        self._carry_out(["learner", "export", *place], name)

    def _carry_out(self, module: Sequence[str], name: str, good: Sequence[int] = (0,)) -> None:
        """Run a module with its arguments to its end, with its output in a log, and add up what it took."""
        log = self._log(name)
        log.parent.mkdir(parents=True, exist_ok=True)
        began = time.monotonic()
        with log.open("ab") as output:
            with self._lock:
                if self.stopped.is_set():
                    raise StepError(f"{name} was not begun: stopped")
                process = subprocess.Popen(
                    [sys.executable, "-P", "-m", *module],
                    cwd=self._folders.work,
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=output,
                    # Ctrl-C is for this process, which then stops the others.
                    start_new_session=True,
                )
                self._running.add(process)
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        with self._lock:
            self._running.discard(process)
            self._add_cost(name, (used.ru_utime + used.ru_stime) / 3600, (time.monotonic() - began) / 3600)
            if self.stopped.is_set():
                raise StepError(f"{name} was stopped: the same command continues")
        if process.returncode not in good:
            raise StepError(f"{name} failed with exit code {process.returncode}: see {log}")

    def _add_cost(self, name: str, core_hours: float, hours: float) -> None:
        release = self._folders.release
        costs = read_costs(self._folders)
        before = costs.get(name, Cost())
        costs[name] = Cost(round(before.core_hours + core_hours, 4), round(before.hours + hours, 4))
        release.mkdir(parents=True, exist_ok=True)
        text = json.dumps({key: asdict(costs[key]) for key in sorted(costs)}, indent=1)
        temporary = release / f".{COSTS}.tmp"
        temporary.write_text(text + "\n", "utf-8")
        temporary.replace(release / COSTS)

    def _log(self, name: str) -> Path:
        return self._folders.work / "logs" / f"{name}.log"
