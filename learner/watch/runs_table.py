"""Prints a table of runs."""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Sequence
from typing import Literal

from common.cli import output_console, whole_table
from learner.run.summary import RunSummary


def show_runs(summaries: Sequence[RunSummary], style: Literal["text", "csv", "json"]) -> None:
    """Print runs to standard output: a table for people, or every value for programs.

    Args:
        summaries: at least one.
        style: ``text``; ``csv`` with a column for every value that some run has; ``json``, a list of objects.
    """
    rows = [summary.flat() for summary in summaries]
    if style == "json":
        sys.stdout.write(json.dumps(rows, indent=2) + "\n")
    elif style == "csv":
        titles = list(dict.fromkeys(name for row in rows for name in row))
        writer = csv.DictWriter(sys.stdout, titles, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    else:
        table = whole_table(
            "run", "state", "task", "updates", "steps", "hours", "best", "success", "distance", box=None, pad_edge=False
        )
        for summary in summaries:
            table.add_row(*_cells(summary))
        output_console().print(table)


def _cells(summary: RunSummary) -> list[str]:
    evaluated = [f"{summary.best['success']:.0%}", f"{summary.best['distance']:.1f} m"] if summary.best else ["-", "-"]
    return [
        summary.name,
        summary.state,
        f"{summary.task}, {summary.algorithm}",
        f"{summary.updates:,} of {summary.total_updates:,}",
        f"{summary.steps:,}",
        f"{summary.hours:.1f}",
        f"version {summary.best_version}" if summary.best_version >= 0 else "-",
        *evaluated,
    ]
