"""Measure everything: ``make bench``, or ``python -m benchmarks [NAME ...] [--json FILE]``.

Each part runs in a process of its own, one at a time, as its commands would run it: malloc and Zenoh set up, and one
thread of the numerical libraries unless the part says otherwise. The figures describe this machine at this moment;
compare within one run. ``--page FILE`` measures nothing: it writes a file of figures into docs/speed.md.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from rich.table import Table

from benchmarks.blocks import with_block
from benchmarks.record import Record, markdown, number
from common.cli import output_console
from common.errors import ConfigError
from common.system.runtime import process_environment

PAGE: Final = Path(__file__).parents[1] / "docs" / "speed.md"
BEGIN: Final = "<!-- made by `python -m benchmarks --page FILE` -->"
_SMALL_WORLDS: Final = "generator:rooms?width=256&height=192"


@dataclass(frozen=True, slots=True)
class Part:
    """A part of the benchmarks, a module of this folder with a function `run`.

    Attributes:
        what: it measures.
        threads: of the numerical libraries; None for all cores, as in the learner.
        short: arguments of `run` with which it takes a moment; None where a moment shows nothing.
    """

    what: str
    threads: int | None = 1
    short: Mapping[str, Any] | None = field(default_factory=dict)


PARTS: Final[Mapping[str, Part]] = {
    "machine": Part("the machine itself, without this project", short={"repeats": 1}),
    "decision_step": Part(
        "belief, frontiers, graph, utility, beacons, observation: one decision on one core",
        short={"source": _SMALL_WORLDS, "worlds": 1},
    ),
    "large_plan": Part(
        "a step of the mapper in a building of 265 m x 88 m that is wholly explored, and its memory",
        short={"steps": 3},
    ),
    "simulators": Part(
        "reset, scan and a leg of 4 m of each simulator and fidelity", short={"repeats": 1, "worlds": 1}
    ),
    "inference": Part("the policy at batch 1 on one core", short={"repeats": 4, "large": [500]}),
    "actor_steps": Part(
        "full steps of one actor on one core",
        short={"seconds": 0.1, "specs": [_SMALL_WORLDS], "cases": ["grid, d 64, labels", "pybullet kinematic, d 64"]},
    ),
    "updates": Part(
        "updates of the learner at batch 64",
        None,
        {
            "repeats": 1,
            "size": 4,
            "episodes": 1,
            "networks": ["small"],
            "ways": [("fp32_reduced", "fp32", "reduced")],
        },
    ),
    "device_updates": Part(
        "updates on the learner's device, a GPU where there is one, with the batch prepared beforehand",
        None,
        {"device": "cpu", "size": 4, "repeats": 1, "episodes": 1, "networks": ["small"]},
    ),
    "ranks": Part("an update that 1, 2 and 4 learner processes share", short=None),
    "replay": Part("the replay buffer", short={"capacity": 1_000}),
    "ingest": Part("chunks through codec and bus, weights to actors", short={"chunks": 10, "processes": [1]}),
    "acknowledgement": Part(
        "what it costs to acknowledge from the disk instead of from memory",
        short={"chunks": 10, "seconds": 1.2, "processes": 1},
    ),
    "page": Part(
        "the pages of a robot and of a training at 0, 1 and 10 browsers, and a control loop beside the first",
        short={"seconds": 1.0, "counts": [0, 1], "turns": 1, "actors": 1},
    ),
    "memory": Part("resident memory of each process of a run", None, None),
}

_CALL = """
import json, sys
from benchmarks.{0} import run
json.dump(run(**json.loads(sys.argv[2])), open(sys.argv[1], "w"))
"""


def measure(name: str, short: bool, folder: Path) -> dict[str, float] | None:
    """Run one part; None when it failed, with its output shown."""
    part = PARTS[name]
    out = folder / f".{name}.json"
    done = subprocess.run(
        [sys.executable, "-c", _CALL.format(name), str(out), json.dumps(dict(part.short or {}) if short else {})],
        check=False,
        env=process_environment(threads=part.threads),
        capture_output=True,
        text=True,
    )
    if done.returncode:
        sys.stderr.write(f"{name} failed with exit code {done.returncode}:\n{done.stdout}{done.stderr}\n")
        return None
    figures: dict[str, float] = json.loads(out.read_text())
    out.unlink()
    return figures


def write_page(record: Record, page: Path) -> None:
    """Put a record into the page about speed, in the place of the one before."""
    table = markdown(record, {name: part.what for name, part in PARTS.items()})
    page.write_text(with_block(page.read_text("utf-8"), BEGIN, table), "utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Print one table per part; the exit code tells whether all could be measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", metavar="NAME", help=f"parts to measure: {', '.join(PARTS)}; default all")
    parser.add_argument("--short", action="store_true", help="each part once and small, which says only that it runs")
    parser.add_argument("--json", type=Path, help="write all figures, the machine and the commit to this file too")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the figures of such a file into docs/speed.md")
    chosen = parser.parse_args(arguments)
    unknown = set(chosen.parts) - set(PARTS)
    if unknown:
        parser.error(f"unknown part {sorted(unknown)[0]!r}: choose from {', '.join(PARTS)}")
    if chosen.page:
        try:
            write_page(Record.read(chosen.page), PAGE)
        except ConfigError as error:
            parser.error(str(error))
        return 0
    console = output_console()
    load = os.getloadavg()[0]
    results: dict[str, dict[str, float]] = {}
    failed = False
    for name in chosen.parts or [name for name, part in PARTS.items() if part.short is not None or not chosen.short]:
        began = time.monotonic()
        figures = measure(name, chosen.short, Path.cwd())
        if figures is None:
            failed = True
            continue
        results[name] = figures
        title = f"{name}: {PARTS[name].what} ({time.monotonic() - began:.0f} s, load {os.getloadavg()[0]:.1f})"
        _show(title, figures)
        # After each part: what was measured outlives a run that is broken off.
        if chosen.json:
            Record.of(results, load, short=chosen.short).write(chosen.json)
    record = Record.of(results, load, short=chosen.short)
    if record.ratios:
        _show("ratios within this run", record.ratios)
    console.print(f"{record.machine}, commit {record.commit[:9]}")
    return int(failed)


def _show(title: str, figures: Mapping[str, float]) -> None:
    table = Table(box=None, show_header=False)
    for name, value in figures.items():
        table.add_row(name, number(value))
    console = output_console()
    console.print(title)
    console.print(table)


if __name__ == "__main__":
    sys.exit(main())
