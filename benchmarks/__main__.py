"""Measure everything: ``make bench``, or ``python -m benchmarks [NAME ...] [--json FILE]``.

Each part runs in a process of its own, one at a time, as its commands would run it: malloc and Zenoh set up, and one
thread of the numerical libraries unless the part says otherwise. The figures describe this machine at this moment;
compare within one run.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from pathlib import Path

from rich.table import Table

from common.cli import output_console
from common.system.runtime import process_environment

# Part, what it measures, threads of the numerical libraries (None: all cores, as in the learner).
PARTS: dict[str, tuple[str, int | None]] = {
    "decision_step": ("belief, frontiers, graph, utility, beacons, observation: one decision on one core", 1),
    "large_plan": ("a step of the mapper in a building of 265 m x 88 m that is wholly explored, and its memory", 1),
    "simulators": ("reset, scan and a leg of 4 m of each simulator and fidelity", 1),
    "inference": ("the policy at batch 1 on one core", 1),
    "actor_steps": ("full steps of one actor on one core", 1),
    "updates": ("updates of the learner at batch 64", None),
    "replay": ("the replay buffer", 1),
    "ingest": ("chunks through codec and bus, weights to actors", 1),
    "acknowledgement": ("what it costs to acknowledge from the disk instead of from memory", 1),
    "page": ("the page of a robot at 0, 1 and 10 browsers, and a control loop beside it", 1),
    "memory": ("resident memory of each process of a run", None),
}

_CALL = "import json, sys; from benchmarks.{0} import run; json.dump(run(), open(sys.argv[1], 'w'))"


def measure(part: str, threads: int | None, folder: Path) -> dict[str, float] | None:
    """Run one part; None when it failed, with its output shown."""
    out = folder / f".{part}.json"
    done = subprocess.run(
        [sys.executable, "-c", _CALL.format(part), str(out)],
        check=False,
        env=process_environment(threads=threads),
        capture_output=True,
        text=True,
    )
    if done.returncode:
        sys.stderr.write(f"{part} failed with exit code {done.returncode}:\n{done.stdout}{done.stderr}\n")
        return None
    figures: dict[str, float] = json.loads(out.read_text())
    out.unlink()
    return figures


def main() -> int:
    """Print one table per part; the exit code tells whether all could be measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", metavar="NAME", help=f"parts to measure: {', '.join(PARTS)}; default all")
    parser.add_argument("--json", type=Path, help="write all figures to this file too")
    arguments = parser.parse_args()
    unknown = set(arguments.parts) - set(PARTS)
    if unknown:
        parser.error(f"unknown part {sorted(unknown)[0]!r}: choose from {', '.join(PARTS)}")
    console = output_console()
    console.print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, load {_load()}")
    results: dict[str, dict[str, float]] = {}
    failed = False
    for part in arguments.parts or PARTS:
        what, threads = PARTS[part]
        began = time.monotonic()
        figures = measure(part, threads, Path.cwd())
        if figures is None:
            failed = True
            continue
        results[part] = figures
        title = f"{part}: {what} ({time.monotonic() - began:.0f} s, load {_load()})"
        table = Table(title=title, title_justify="left", box=None, show_header=False)
        for name, value in figures.items():
            table.add_row(name, f"{value:,.3f}" if abs(value) < 100 else f"{value:,.0f}")
        console.print(table)
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=2) + "\n")
    return int(failed)


def _load() -> str:
    return f"{os.getloadavg()[0]:.1f}"


if __name__ == "__main__":
    sys.exit(main())
