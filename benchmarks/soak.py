"""Break things for half an hour: ``make soak``, or ``python -m benchmarks.soak [--minutes 30] [--every 60]``.

A simulated robot under physics drives from place to place in an office, led by a real bridge on a real bus. Every
minute something fails: sensors, poses, clocks, links, processes, people. The table says for each fault what had to be
seen, what was seen, how soon the robot stood, and how far it drove until then. The exit code is 0 when nothing was
touched, every stop came within its limit, the robot drove on each time, and the bridge's memory stayed within 20 MB.
"""

from __future__ import annotations

import argparse
import itertools
import json
import logging
import os
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any, Final

from rich import box
from rich.console import Console
from rich.table import Table

from benchmarks.soak_faults import FAULTS, Fault, breaking
from benchmarks.soak_rig import START_SECONDS, Rig, SoakError
from benchmarks.soak_robot import standstill, way
from common.system.logs import setup_logging
from deploy.robot.options import RobotOptions

log = logging.getLogger(__name__)

GROWTH_LIMIT: Final = 20e6
"""Bytes by which the bridge may grow."""
# A robot that stands may be moved by the solver a little; metres.
_CREEP: Final = 0.1
# The base heard no velocity for so long, seconds.
_SILENT: Final = 1.0
# Characters of a warning in the table.
_WORDS: Final = 50
# What a process takes for its first tasks is no growth, seconds; a shorter life tells nothing.
_WARM: Final = 120.0


@dataclass(frozen=True, slots=True)
class Row:
    """What came of a fault.

    Attributes:
        minute: of the soak.
        fault: in words.
        expected: what had to be told.
        seen: what was told.
        limit: seconds in which the robot had to stand; None where it need not.
        seconds: until it stood; None where it did not.
        metres: driven until it stood, or until the fault was over.
        back: seconds from the fault's end until it drove again; None where it did not.
        wrong: what was not as it should be; empty when nothing.
    """

    minute: float
    fault: str
    expected: str
    seen: tuple[str, ...]
    limit: float | None
    seconds: float | None
    metres: float
    back: float | None
    wrong: str


def soak(rig: Rig, minutes: float, every: float, faults: Sequence[Fault] = FAULTS) -> list[Row]:
    """Break one thing after the other for some minutes, and return what came of each.

    Raises:
        SoakError: the robot does not begin to drive.
    """
    if not rig.roll(START_SECONDS):
        raise SoakError(f"the robot does not begin to drive; the bridge says {rig.status}")
    began = time.monotonic()
    rows: list[Row] = []
    for number, fault in enumerate(itertools.cycle(faults)):
        rig.until(lambda due=began + number * every: time.monotonic() >= due, every + 1.0)  # type: ignore[misc]
        if time.monotonic() - began >= minutes * 60.0:
            return rows
        row = _try(rig, fault, (time.monotonic() - began) / 60.0)
        rows.append(row)
        log.info("%s: %s", row.fault, row.wrong or "as it should be")
    return rows


def _try(rig: Rig, fault: Fault, minute: float) -> Row:
    """Break one thing while the robot drives."""
    expected = " or ".join(fault.expected) or "nothing"
    if not rig.roll(60.0):
        return Row(minute, fault.name, expected, (), fault.limit, None, 0.0, None, "the robot did not drive before it")
    touched = rig.robot.collisions
    rig.heard.clear()
    at = time.monotonic()
    with breaking(fault, rig):
        # Goals are not given meanwhile: what stops the robot must be the fault.
        time.sleep(max(0.0, at + fault.lasts - time.monotonic()))
        motions = rig.robot.since(at)
        over = time.monotonic()
        if rig.silent_for > _SILENT:
            rig.heard.add("no velocities")
    back = rig.roll(fault.restart)
    seconds = time.monotonic() - over
    seen = rig.heard.copy()
    stood = standstill(motions)
    took = None if stood is None else stood.time - at
    until = [motion for motion in motions if stood is None or motion.time <= stood.time]
    after = [motion for motion in motions if stood is not None and motion.time > stood.time]
    problems = []
    if fault.expected and not any(word in text for word in fault.expected for text in seen):
        problems.append(f"nothing told of {expected}")
    if fault.limit is not None and (took is None or took > fault.limit):
        problems.append("did not stand" if took is None else f"stood after {took:.2f} s")
    if fault.limit is not None and fault.holds and way(after) > _CREEP:
        problems.append(f"moved on by {way(after):.2f} m")
    if not back:
        problems.append(f"did not drive on within {fault.restart:g} s")
    if rig.robot.collisions > touched:
        problems.append(f"{rig.robot.collisions - touched} collisions")
    return Row(
        round(minute, 1),
        fault.name,
        expected,
        tuple(sorted(_told(seen, fault.expected))),
        fault.limit,
        None if took is None else round(took, 2),
        round(way(until), 2),
        round(seconds, 1) if back else None,
        "; ".join(problems),
    )


def _told(heard: set[str], expected: Sequence[str]) -> Iterator[str]:
    """Yield kinds and states, and of all warnings those that were waited for."""
    for text in heard:
        if " " not in text or text in expected:
            yield text
        elif any(word in text for word in expected):
            yield f"warned: {text if len(text) < _WORDS else text[: _WORDS - 3] + '...'}"


def growth(samples: Sequence[tuple[float, int]], warm: float = _WARM) -> float | None:
    """Return by how many bytes a process grew after its first minutes; None for one that did not live long enough."""
    if not samples or samples[-1][0] - samples[0][0] < 2.0 * warm:
        return None
    first, last = samples[0][0] + warm, samples[-1][0]
    early = [size for at, size in samples if first <= at < first + warm / 4.0]
    late = [size for at, size in samples if at > last - warm / 4.0]
    return median(late) - median(early)


def table(rows: Sequence[Row]) -> Table:
    """Show what came of all faults."""
    found = Table(box=box.MARKDOWN)
    titles = "minute", "fault", "expected", "seen", "stands after, s", "limit, s", "metres", "drives on after, s", ""
    for title in titles:
        found.add_column(title)
    for row in rows:
        found.add_row(
            f"{row.minute:.1f}",
            row.fault,
            row.expected,
            ", ".join(row.seen),
            "" if row.seconds is None else f"{row.seconds:.2f}",
            "" if row.limit is None else f"{row.limit:.1f}",
            f"{row.metres:.2f}",
            "" if row.back is None else f"{row.back:.1f}",
            row.wrong or "right",
        )
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the soak and print its table; the exit code tells whether all was right."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=30.0, help="how long (default 30)")
    parser.add_argument("--every", type=float, default=60.0, help="seconds between two faults (default 60)")
    parser.add_argument("--map", default=RobotOptions().map, help="world (default: an office)")
    parser.add_argument("--seed", type=int, default=0, help="of the world and of the noise (default 0)")
    parser.add_argument("--folder", type=Path, default=Path("runs/soak"), help="for the logs (default runs/soak)")
    parser.add_argument("--json", type=Path, help="write all figures to this file too")
    chosen = parser.parse_args(arguments)
    setup_logging("info")
    options = RobotOptions(map=chosen.map, seed=chosen.seed, range_noise=0.02)
    with Rig(options, chosen.folder) as rig:
        rows = soak(rig, chosen.minutes, chosen.every)
        figures: dict[str, Any] = {
            "faults": len(rows),
            "wrong": sum(bool(row.wrong) for row in rows),
            "collisions": rig.robot.collisions,
            "metres": round(rig.robot.motion.distance, 1),
            "real_time_factor": round(rig.robot.real_time_factor, 2),
            "growth_mb": [round(grown / 1e6, 1) for each in rig.memory.values() if (grown := growth(each)) is not None],
            "load": round(os.getloadavg()[0], 1),
        }
    console = Console(width=240)
    console.print(table(rows))
    console.print(figures)
    if chosen.json:
        chosen.json.write_text(json.dumps({**figures, "rows": [asdict(row) for row in rows]}, indent=2) + "\n", "utf-8")
    grown = any(1e6 * each > GROWTH_LIMIT for each in figures["growth_mb"])
    return int(figures["wrong"] > 0 or figures["collisions"] > 0 or grown)


if __name__ == "__main__":
    sys.exit(main())
