"""Options that the commands of `hd-eval` share, and where they write."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from common.cli import completing
from common.tasks import TASKS

Planners = Annotated[
    list[str],
    typer.Option(
        "--planner",
        metavar="NAME[,NAME...]",
        help="Planners (see hd-eval planners), `omniscient`, or MODULE:CLASS.",
    ),
]
Maps = Annotated[
    list[str],
    typer.Option(
        "--maps",
        metavar="SOURCE",
        help="A folder of maps (with its subfolders), a map file (image or ROS YAML), either with a set of settings "
        "before it (floorplans:DIR), or generator:NAME[?key=value&...]. May be repeated.",
    ),
]
Start = Annotated[
    tuple[float, float] | None,
    typer.Option("--start", metavar="X Y", help="Start in the one map file of --maps, metres, map frame."),
]
Target = Annotated[
    tuple[float, float] | None,
    typer.Option("--target", metavar="X Y", help="Target in the one map file of --maps, metres, map frame."),
]
Limit = Annotated[
    int | None,
    typer.Option("--limit", min=1, metavar="N", help="Only N maps, spread evenly. [default: all; 100 of a generator]"),
]
Label = Annotated[
    str | None,
    typer.Option("--label", metavar="NAME", help="Name of the one planner in the results. [default: its own]"),
]
CopyTo = Annotated[
    str | None,
    typer.Option("--copy-to", metavar="URL", help="Copy the results to this folder too, such as s3://BUCKET/FOLDER."),
]
OutFolder = Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the results; created if missing.")]
Jobs = Annotated[int, typer.Option("--jobs", "-j", min=0, help="Processes; 0 for one per core.")]
TimeLimit = Annotated[
    float,
    typer.Option("--time-limit", min=0.001, metavar="SECONDS", help="Processor time; a slower decision fails."),
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Start over instead of continuing.")]
ConfigFile = Annotated[
    Path | None,
    typer.Option("--config", metavar="FILE", help="TOML or JSON file with mapping, task and simulator settings."),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="SECTION.FIELD=VALUE", help="Change one setting, such as task.max_steps=256."),
]
TaskName = Annotated[
    str,
    typer.Option(
        "--task",
        metavar="NAME",
        help="Task: exploration, navigation, one from an installed package, or MODULE:NAME.",
        autocompletion=completing(TASKS),
    ),
]
ResultsPaths = Annotated[
    list[str], typer.Argument(metavar="RESULTS...", help="Results files, or folders that hold them; URLs as well.")
]
PicturesFolder = Annotated[
    Path, typer.Option("--out", metavar="DIR", help="Folder for the pictures; created if missing.")
]
Suffix = Annotated[str, typer.Option("--suffix", help="Format: png, svg or pdf.")]


class TableFormat(StrEnum):
    """Formats of the table."""

    TEXT = "text"
    MARKDOWN = "markdown"
    LATEX = "latex"
    CSV = "csv"


TableStyle = Annotated[TableFormat, typer.Option("--format", help="Format of the table.")]
TextFile = Annotated[Path | None, typer.Option("--out", metavar="FILE", help="Write it there instead.")]


def write_text(text: str, path: Path | None) -> None:
    """Write a text to a file, or to the standard output where none is named; `ResultsError` when that cannot be."""
    from actors.evaluation.results import ResultsError

    if path is None:
        sys.stdout.write(text)
        return
    try:
        path.write_text(text, "utf-8")
    except OSError as error:
        raise ResultsError(f"cannot write {path} ({error.strerror}): check the folder") from error
