"""Brings docs/paper.md up to date from what is kept: claims, tables, trainings and costs."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from actors.evaluation.large import table as large_table
from actors.evaluation.large.results import LargeResults, read_large_results
from actors.evaluation.results import Results, read_results
from actors.evaluation.table import number, render
from benchmarks.blocks import with_block
from benchmarks.paper.ablation import ablation
from benchmarks.paper.claims import CLAIMS, Found
from benchmarks.paper.curves import AT, curves
from benchmarks.paper.plan import SEEDS, TABLES, TRAININGS, UPDATES, Row, Table
from benchmarks.paper.steps import Folders, read_costs
from benchmarks.planners import table_of
from common.system.documents import read_json

PAGE: Final = Path(__file__).parents[2] / "docs" / "paper.md"


def write_page(folders: Folders, page: Path = PAGE) -> None:
    """Exchange the generated parts of the page; the words are left as they are, and have to be read again.

    Raises:
        ConfigError: the page lacks the comments between which these parts stand.
        ResultsError: results that are kept are damaged.
    """
    plain: dict[str, list[Results]] = {}
    parts: list[str] = []
    for table in TABLES:
        done = [row for row in table.rows if folders.packed(table, row).exists()]
        text, plain[table.name] = _table(table, done, folders)
        waiting = [_waiting(row, folders) for row in table.rows if row not in done]
        parts.append(
            "\n\n".join(part for part in (f"### {table.title}", text, _command(table), _left(waiting)) if part)
        )
    text = page.read_text("utf-8")
    text = with_block(text, _begin("claims"), _claims(plain))
    text = with_block(text, _begin("ablation"), ablation(plain))
    text = with_block(text, _begin("curves"), _curves(folders))
    text = with_block(text, _begin("tables"), "\n\n".join(parts))
    text = with_block(text, _begin("trainings"), _trainings(folders))
    page.write_text(text, "utf-8")


def _begin(part: str) -> str:
    return f"<!-- {part}: made by benchmarks.paper -->"


def _table(table: Table, rows: Sequence[Row], folders: Folders) -> tuple[str, list[Results]]:
    """Return a table as Markdown, and its results in the form that comparisons take."""
    files = [folders.packed(table, row) for row in rows]
    if not files:
        return "", []
    baseline = table.baseline if any(row.label == table.baseline for row in rows) else None
    if table.kind == "demo":
        return _verdicts(rows, files), []
    if table.kind == "large":
        large: list[LargeResults] = [read_large_results(file) for file in files]
        titles, cells = large_table.make_rows(large, baseline)
        text = render(titles, cells, "markdown").strip()
        remarks = "\n".join(f"- {note}" for note in large_table.notes(large, baseline))
        return f"{text}\n\n{remarks}", [each.plain() for each in large]
    found = [read_results(file) for file in files]
    return table_of(found, baseline), found


def _verdicts(rows: Sequence[Row], files: Sequence[Path]) -> str:
    titles = ["planner", "done", "explored", "distance [m]", "time [s]", "p95 of a decision [ms]", "collisions"]
    cells = []
    for row, file in zip(rows, files, strict=True):
        verdict = read_json(file)
        cells.append(
            [
                row.label,
                "yes" if verdict["success"] else f"no: {verdict['reason']}",
                f"{100 * verdict['explored']:.1f} %",
                number(verdict["distance"], 1),
                number(verdict["seconds"], 0),
                number(1e3 * verdict["decision_p95"], 0),
                str(verdict["collisions"]),
            ]
        )
    return render(titles, cells, "markdown").strip()


def _claims(found: Found) -> str:
    rows = []
    for claim in CLAIMS:
        verdict = claim.judge(found)
        rows.append([claim.where, claim.statement, claim.published, verdict.figure or "-", verdict.words])
    return render(["about", "claim", "paper", "here", "verdict"], rows, "markdown").strip()


def _curves(folders: Folders) -> str:
    kept = {}
    for training in TRAININGS:
        for seed in SEEDS:
            files = {at: folders.point(training.name, seed, at) for at in AT}
            if points := {at: read_results(file) for at, file in files.items() if file.exists()}:
                kept[f"{training.name}-{seed}"] = points
    return curves(kept)


def _trainings(folders: Folders) -> str:
    costs = read_costs(folders)
    rows = []
    for training in TRAININGS:
        for seed in SEEDS:
            name = f"{training.name}-{seed}"
            updates = folders.updates(training.name, seed)
            cost = costs.get(name)
            state = "kept" if folders.policy(training.name, seed).exists() else f"{updates:,} of {UPDATES:,} updates"
            rows.append([name, training.preset, state if updates else "not begun", _hours(cost and cost.core_hours)])
    total = sum(cost.core_hours for cost in costs.values())
    text = render(["training", "preset", "state", "core hours"], rows, "markdown").strip()
    return f"{text}\n\nAll steps that are done took {total:.1f} core hours, {total / 2:.1f} hours of two cores."


def _hours(hours: float | None) -> str:
    return "-" if hours is None else f"{hours:.2f}"


def _waiting(row: Row, folders: Folders) -> str:
    if row.training is None or folders.policy(row.training, row.seed).exists():
        return f"`{row.label}` (not run)"
    return f"`{row.label}` (training: {folders.updates(row.training, row.seed):,} of {UPDATES:,} updates)"


def _left(waiting: Sequence[str]) -> str:
    return f"Not finished: {', '.join(waiting)}." if waiting else ""


def _command(table: Table) -> str:
    command = "hd-deploy demo" if table.kind == "demo" else f"hd-eval {table.kind}"
    options = [option.format(maps="MAPS", scenes="build/paper/scenes") for option in table.options]
    return f"`{command} --planner NAME {shlex.join(options)}`"
