"""The table of an evaluation, as text, Markdown, LaTeX or CSV."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from typing import Literal

from rich.console import Console
from rich.table import Table
from rich.text import Text

from actors.evaluation.omniscient import NAME as OMNISCIENT
from actors.evaluation.results import Results
from actors.evaluation.statistics import Comparison, Summary, compare, distance_ratio, find, group_means, summarise
from common.system.printable import printable

Format = Literal["text", "markdown", "latex", "csv"]
Units = Literal["m", "px"]

Rows = list[list[str]]


def make_rows(found: Sequence[Results], baseline: str | None, units: Units = "m") -> tuple[list[str], Rows]:
    """Return the titles and the rows of the table, one row per planner.

    Args:
        found: results of all planners.
        baseline: planner to compare with, None for none.
        units: of distances: metres, or pixels of the image.

    Raises:
        ResultsError: the baseline is not among the results, or maps do not match.
    """
    reference = None if baseline is None else find(found, baseline)
    omniscient = next((results for results in found if results.planner == OMNISCIENT), None)
    scale = 1.0 if units == "m" else 1.0 / found[0].metres_per_pixel
    folders = list(dict.fromkeys(folder for results in found for folder in group_means(results)))
    titles = ["planner", "maps", *(f"{folder} [{units}]" for folder in folders)]
    titles += [f"mean [{units}]", "std", "success", "explored", "steps", "median [ms]", "p95 [ms]"]
    if omniscient is not None:
        titles.append("/ omniscient")
    if reference is not None:
        titles += [f"/ {baseline}", "95 % interval", "difference", "t-test p", "Wilcoxon p"]
    rows = []
    for results in found:
        summary = summarise(results)
        means = group_means(results)
        row = [summary.planner, str(summary.episodes)]
        row += [number(means.get(folder, math.nan) * scale, 1) for folder in folders]
        row += _summary_cells(summary, scale)
        if omniscient is not None:
            row.append(number(distance_ratio(results, omniscient), 3))
        if reference is not None:
            same = results is reference
            row += ["1", "", "", "", ""] if same else _comparison_cells(compare(results, reference), scale)
        rows.append(row)
    return titles, rows


def notes(found: Sequence[Results], baseline: str | None) -> list[str]:
    """Return what a reader of the table has to know, in sentences."""
    lines = ["Failures count with their distance so far; std is the variety of the maps, not an uncertainty."]
    failures = {
        results.planner: sum(not episode.success for episode in results.episodes)
        for results in found
        if any(not episode.success for episode in results.episodes)
    }
    if failures:
        lines.append("Failures: " + ", ".join(f"{name} {count}" for name, count in failures.items()) + ".")
    lines += _unseen(found)
    if len({frozenset(episode.map for episode in results.episodes) for results in found}) > 1:
        lines.append("Not all planners have the same maps: means differ in their maps, ratios and tests are paired.")
    ranges = sorted({results.sensor_range_m for results in found})
    if len(ranges) > 1:
        lines.append(f"Sensor ranges differ ({', '.join(f'{each:g}' for each in ranges)} m): so do the distances.")
    if baseline is not None:
        lines.append(
            f"Ratios and differences are paired by map with {baseline}; interval: bootstrap over maps, 9,999 resamples."
        )
    if any(results.planner == "hdplanner" for results in found):
        lines.append(
            "hdplanner: with the rule that ends cycles and, for the shipped policies, the guard that hands over to a "
            "classical planner in worlds unlike their training; hdplanner-bare: the network alone."
        )
    commits = list(dict.fromkeys(results.commit for results in found))
    lines.append(f"Commit {'; '.join(commits)}; seed {', '.join(sorted({str(results.seed) for results in found}))}.")
    return lines


def _unseen(found: Sequence[Results]) -> list[str]:
    """Say which explorations ended although much was unseen."""
    lines = []
    for results in found:
        left = [episode for episode in results.episodes if episode.unseen_m2 > 0.0]
        if left:
            most = max(left, key=lambda episode: episode.unseen_m2)
            lines.append(
                f"{results.planner} left reachable space unseen on {len(left)} maps, most on {most.map}: {most.reason}."
            )
    return lines


def render(titles: Sequence[str], rows: Rows, style: Format, remarks: Sequence[str] = ()) -> str:
    """Write the table out; CSV has no remarks. Names in results of others may hold anything."""
    titles, remarks = [printable(title) for title in titles], [printable(remark) for remark in remarks]
    rows = [[printable(cell) for cell in row] for row in rows]
    if style == "csv":
        out = io.StringIO()
        csv.writer(out, lineterminator="\n").writerows([list(titles), *rows])
        return out.getvalue()
    if style == "markdown":
        return _markdown(titles, rows, remarks)
    if style == "latex":
        return _latex(titles, rows, remarks)
    return _text(titles, rows, remarks)


def _summary_cells(summary: Summary, scale: float) -> list[str]:
    return [
        number(summary.mean * scale, 1),
        number(summary.std * scale, 1),
        f"{100 * summary.success:.1f} %",
        f"{100 * summary.explored:.1f} %",
        number(summary.steps, 1),
        number(summary.median_ms, 2),
        number(summary.p95_ms, 2),
    ]


def _comparison_cells(comparison: Comparison, scale: float) -> list[str]:
    return [
        number(comparison.ratio, 3),
        "-" if math.isnan(comparison.low) else f"{comparison.low:.3f} to {comparison.high:.3f}",
        f"{comparison.difference * scale:+.1f}",
        _probability(comparison.t_p),
        _probability(comparison.wilcoxon_p),
    ]


def number(value: float, places: int) -> str:
    """Return a figure with so many decimal places, a dash for nan."""
    return "-" if math.isnan(value) else f"{value:.{places}f}"


def _probability(value: float) -> str:
    if math.isnan(value):
        return "-"
    return f"{value:.3f}" if value >= 0.001 else f"{value:.0e}"


def _text(titles: Sequence[str], rows: Rows, remarks: Sequence[str]) -> str:
    table = Table(box=None, pad_edge=False)
    for number, title in enumerate(titles):
        table.add_column(Text(title), justify="left" if number == 0 else "right", no_wrap=True)
    for row in rows:
        table.add_row(*map(Text, row))
    console = Console(file=io.StringIO(), width=400, color_system=None)
    console.print(table)
    assert isinstance(console.file, io.StringIO)
    lines = [line.rstrip() for line in console.file.getvalue().splitlines()]
    return "\n".join([*lines, "", *remarks]) + "\n"


def _markdown(titles: Sequence[str], rows: Rows, remarks: Sequence[str]) -> str:
    cells = [[cell.replace("|", "\\|") for cell in row] for row in (titles, *rows)]
    lines = ["| " + " | ".join(row) + " |" for row in cells]
    lines.insert(1, "| --- |" + " ---: |" * (len(titles) - 1))
    return "\n".join([*lines, "", *remarks]) + "\n"


def _latex(titles: Sequence[str], rows: Rows, remarks: Sequence[str]) -> str:
    lines = [f"% {remark}" for remark in remarks]
    lines += ["\\begin{tabular}{l" + "r" * (len(titles) - 1) + "}", "\\toprule"]
    lines += [" & ".join(map(_escape, titles)) + " \\\\", "\\midrule"]
    lines += [" & ".join(map(_escape, row)) + " \\\\" for row in rows]
    return "\n".join([*lines, "\\bottomrule", "\\end{tabular}"]) + "\n"


def _escape(text: str) -> str:
    return text.translate(_LATEX)


_NAMED = {"\\": "\\textbackslash{}", "~": "\\textasciitilde{}", "^": "\\textasciicircum{}"}
_LATEX = str.maketrans(_NAMED | {character: f"\\{character}" for character in "&%$#_{}"})
