"""`summary.json` of a run: the figures that stand for it in a table of runs."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, Final

from pydantic import TypeAdapter, ValidationError

from common.errors import CheckpointError
from common.problems import first_problem
from common.system.documents import read_json
from learner.run.files import replace_text, to_json

SUMMARY_FILE: Final = "summary.json"


@dataclasses.dataclass(frozen=True, slots=True)
class RunSummary:
    """A run at its newest checkpoint.

    Attributes:
        name: of the run.
        state: what the learner did, see `LearnerStatus`; a run whose learner was killed keeps its last one.
        task: ``exploration``, ``navigation`` or ``both``.
        algorithm: ``sac`` or ``ppo``.
        updates: made.
        total_updates: after which it is complete.
        steps: collected.
        episodes: finished.
        hours: of training, pauses between processes left out.
        best_version: of the best evaluated policy, -1 before the first evaluation.
        best: its means over the validation worlds, see docs/metrics.md.
        seed: of the run.
        commit: of the code.
        written: when, ISO 8601.
    """

    name: str
    state: str
    task: str
    algorithm: str
    updates: int
    total_updates: int
    steps: int
    episodes: int
    hours: float
    best_version: int
    best: dict[str, float]
    seed: int
    commit: str
    written: str

    def flat(self) -> dict[str, Any]:
        """Return one value per name, the means of the best policy as ``best/NAME``."""
        values = dataclasses.asdict(self)
        del values["best"]
        return {**values, **{f"best/{name}": value for name, value in self.best.items()}}


def write_summary(folder: Path, summary: RunSummary) -> None:
    """Write a run's summary at one stroke.

    Raises:
        StorageError: the disk refuses it.
    """
    replace_text(folder / SUMMARY_FILE, to_json(dataclasses.asdict(summary)))


def read_summaries(runs: Path) -> tuple[list[RunSummary], list[str]]:
    """Return the summaries of all runs in a folder, by name; runs of earlier releases have none and are left out.

    Returns:
        The summaries, and for each that cannot be read what is wrong with it: one must not hide the others.

    Raises:
        CheckpointError: there is no run with a summary, or the folder cannot be read.
    """
    found, problems = [], []
    try:
        folders = sorted(entry for entry in runs.iterdir() if not entry.name.startswith("."))
    except FileNotFoundError:
        folders = []
    except OSError as error:
        raise CheckpointError(f"cannot read the folder of runs {runs}: {error.strerror or error}") from error
    for folder in folders:
        path = folder / SUMMARY_FILE
        try:
            found.append(_summary(read_json(path)))
        except (FileNotFoundError, NotADirectoryError):
            continue
        except OSError as error:
            problems.append(f"{path} cannot be read: {error.strerror or error}")
        except ValueError as error:
            problems.append(f"{path} cannot be read ({error}): delete it, the next checkpoint writes it again")
    if not found and not problems:
        raise CheckpointError(f"there is no run with a {SUMMARY_FILE} in {runs}: a checkpoint writes one")
    return found, problems


def _summary(document: object) -> RunSummary:
    """Check a summary's fields; those of a later release are passed over."""
    try:
        summary = TypeAdapter(RunSummary).validate_python(document)
    except ValidationError as error:
        first = first_problem(error)
        raise ValueError(f"{first.path or 'the file'}: {first.words}, got {first.given!r:.80}") from None
    if missing := [name for name in ("success", "distance") if summary.best and name not in summary.best]:
        raise ValueError(f"best.{missing[0]}: Field required")
    return summary
