"""Options that the commands of `hd-eval` share, and what they make together."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from actors.evaluation.results import Results, ResultsError
from actors.evaluation.settings import EvaluationSettings
from actors.evaluation.worlds import WorldSet
from common.config.load import load_config

Maps = Annotated[
    list[str],
    typer.Option(
        "--maps",
        metavar="SOURCE",
        help="A folder of PNG maps (with its subfolders), or generator:NAME[?key=value&...]. May be repeated.",
    ),
]
Limit = Annotated[
    int | None,
    typer.Option("--limit", min=1, metavar="N", help="Only N maps, spread evenly. [default: all; 100 of a generator]"),
]
ConfigFile = Annotated[
    Path | None,
    typer.Option("--config", metavar="FILE", help="TOML or JSON file with mapping, task and simulator settings."),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="SECTION.FIELD=VALUE", help="Change one setting, such as task.max_steps=256."),
]
ResultsPaths = Annotated[
    list[Path], typer.Argument(metavar="RESULTS...", help="Results files, or folders that hold them.")
]


class TaskChoice(StrEnum):
    """Tasks to choose from."""

    EXPLORATION = "exploration"
    NAVIGATION = "navigation"


class TableFormat(StrEnum):
    """Formats of the table."""

    TEXT = "text"
    MARKDOWN = "markdown"
    LATEX = "latex"
    CSV = "csv"


def resolve(
    maps: Sequence[str],
    limit: int | None,
    config: Path | None,
    overrides: Sequence[str] | None,
    *,
    task: str | None = None,
    simulator: str = "grid",
    fidelity: str | None = None,
    metres_per_pixel: float | None = None,
    seed: int = 0,
    time_limit: float = 10.0,
    policy: Path | None = None,
) -> EvaluationSettings:
    """Return the settings of an evaluation: configuration file, environment, ``--set``, then the command's own.

    Raises:
        ConfigError: a setting is unknown or out of range.
    """
    own = [f"simulator.name={simulator}", *(overrides or [])]
    if task is not None:
        own.append(f"task.name={task}")
    if fidelity is not None:
        own.append(f"simulator.fidelity={fidelity}")
    if metres_per_pixel is not None:
        own.append(f"maps.metres_per_pixel={metres_per_pixel}")
    run = load_config(config, own, os.environ)
    return EvaluationSettings(
        maps=tuple(maps),
        limit=limit,
        metres_per_pixel=run.maps.metres_per_pixel,
        task=run.task,
        mapping=run.mapping,
        simulator=run.simulator,
        seed=seed,
        time_limit=time_limit,
        policy=None if policy is None else str(policy.expanduser().resolve()),
    )


def settings_of(
    results: Results, maps: Sequence[str], limit: int | None, config: Path | None, overrides: Sequence[str] | None
) -> tuple[EvaluationSettings, WorldSet]:
    """Return settings that suit a results file, and the worlds to find its maps in.

    Raises:
        ConfigError: a setting is unknown or out of range.
        MapError: a source cannot be used.
    """
    settings = resolve(maps, limit, config, overrides, task=results.task, metres_per_pixel=results.metres_per_pixel)
    return settings, WorldSet.open(settings.maps, results.task, results.metres_per_pixel, limit)


def write_text(text: str, path: Path | None) -> None:
    """Write a text to a file, or to the standard output where none is named; `ResultsError` when that cannot be."""
    if path is None:
        sys.stdout.write(text)
        return
    try:
        path.write_text(text, "utf-8")
    except OSError as error:
        raise ResultsError(f"cannot write {path} ({error.strerror}): check the folder") from error
