"""Try what may fail while a run trains: ``make faults``, or ``python -m benchmarks.faults [--short] [NAME ...]``.

A real learner and real actors on a real bus, a link between them that fails, disks that are full, damaged or without
power, strangers, crowds. The table says for each fault what had to be seen, what was seen, and whether anything that
was acknowledged was lost or counted twice. The exit code is 0 when all was right.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import logging
import os
import random
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Final

from rich.console import Console

from benchmarks.blocks import read_block, with_block
from benchmarks.faults import crowd, processes, storage
from benchmarks.faults.rig import Rig
from benchmarks.faults.table import Row, machine, merged, table
from common.system.logs import setup_logging
from learner.run.code_state import code_state, commit_of
from tests.rigs.disk import MountRefusedError, mounted

log = logging.getLogger(__name__)

PAGE: Final = Path(__file__).parents[2] / "docs" / "faults.md"
BEGIN: Final = "<!-- made by `python -m benchmarks.faults --page` -->"
_DISK_MEGABYTES: Final = 256


@dataclass(frozen=True, slots=True)
class Extent:
    """How much of each fault is tried."""

    kills: int
    frozen: float
    cut: float
    drops: int
    seconds: float
    full: float
    records: int
    hostile: int
    deaths: int
    actors: int
    messages: int
    failures: int
    knocks: int
    rate: float


LONG: Final = Extent(5, 12.0, 12.0, 5, 20.0, 6.0, 12, 1_000_000, 1_000, 200, 60, 200, 5, 50.0)
SHORT: Final = Extent(1, 2.0, 2.0, 1, 1.0, 0.5, 4, 100, 1, 20, 10, 5, 1, 10.0)

ON_A_RIG: Final[Mapping[str, Callable[[Rig, Extent], Row]]] = {
    "freeze": lambda rig, extent: processes.freeze(rig, extent.frozen),
    "cut": lambda rig, extent: processes.cut(rig, extent.cut),
    "break": lambda rig, extent: processes.broken_off(rig, extent.drops),
    "slow": lambda rig, extent: processes.slow(rig, 0.3, 0.0, extent.seconds),
    "lossy": lambda rig, extent: processes.slow(rig, 0.0, 0.05, extent.seconds),
    "narrow": lambda rig, extent: processes.narrow(rig, 400, extent.seconds / 2.0),
    "full": lambda rig, extent: storage.full(rig, extent.full),
    "hostile": lambda rig, extent: crowd.hostile(rig, extent.hostile),
    "deaths": lambda rig, extent: crowd.deaths(rig, extent.deaths),
    "crowd": lambda rig, extent: crowd.crowded(rig, extent.actors, extent.messages),
    "kill": lambda rig, extent: processes.kill(rig, extent.kills),
    "damage": lambda rig, extent: storage.damaged(rig, extent.records, random.Random(0)),
}
"""Faults of one run, in the order in which they come."""
ALONE: Final[Mapping[str, Callable[[Extent], Row]]] = {
    "power": lambda extent: storage.power(extent.failures),
    "certificates": lambda extent: crowd.certificates(extent.knocks),
}
"""Faults that need a learner of their own."""
NAMES: Final = (*ON_A_RIG, *ALONE)


def faults(names: Sequence[str], extent: Extent, folder: Path) -> Iterator[Row]:
    """Try some faults and yield what came of each."""
    if chosen := [name for name in ON_A_RIG if name in names]:
        with contextlib.ExitStack() as stack:
            disk = None
            try:
                disk = stack.enter_context(mounted(folder / "disk", _DISK_MEGABYTES))
            except MountRefusedError as error:
                log.warning("%s", error)
            rig = stack.enter_context(Rig(folder / "rig", disk, extent.rate))
            for name in chosen:
                yield _timed(name, lambda name=name: ON_A_RIG[name](rig, extent))  # type: ignore[misc]
    for name in ALONE:
        if name in names:
            yield _timed(name, lambda name=name: ALONE[name](extent))  # type: ignore[misc]


def _timed(name: str, act: Callable[[], Row]) -> Row:
    began = time.monotonic()
    row = replace(act(), name=name, commit=commit_of(code_state())[:9])
    log.info("%s, %.0f s: %s; %s", name, time.monotonic() - began, row.seen, row.wrong or "right")
    return row


def write_page(rows: Sequence[Row]) -> None:
    """Put rows into the table of docs/faults.md, in the place of earlier ones of the same faults."""
    page = PAGE.read_text("utf-8")
    PAGE.write_text(with_block(page, BEGIN, merged(read_block(page, BEGIN), rows, NAMES)), "utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Try the faults and print the table; the exit code tells whether all was right."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"faults to try: {', '.join(NAMES)}; default all")
    parser.add_argument("--short", action="store_true", help="a little of each: half a minute")
    fields = {name: type(value) for name, value in asdict(LONG).items()}
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=N", help=f"another extent, of {', '.join(fields)}"
    )
    parser.add_argument("--page", action="store_true", help="put the rows into the table of docs/faults.md")
    parser.add_argument("--json", type=Path, help="write all rows to this file too")
    chosen = parser.parse_args(arguments)
    if unknown := sorted(set(chosen.names) - set(NAMES)):
        parser.error(f"unknown fault {unknown[0]!r}: choose from {', '.join(NAMES)}")
    if unknown := sorted({text.partition("=")[0] for text in chosen.set} - fields.keys()):
        parser.error(f"unknown extent {unknown[0]!r}: choose from {', '.join(fields)}")
    setup_logging("info")
    # Whoever ends this program ends its learner and actors too, and unmounts its disk.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    extent = SHORT if chosen.short else LONG
    changes = {name: fields[name](number) for name, _, number in (text.partition("=") for text in chosen.set)}
    extent = replace(extent, **changes)
    with tempfile.TemporaryDirectory(prefix="hd-faults-") as folder:
        rows = []
        for row in faults(chosen.names or NAMES, extent, Path(folder)):
            rows.append(row)
            if chosen.page:
                write_page([row])
    console = Console(width=int(os.environ.get("COLUMNS", "200")))
    console.print(table(rows))
    console.print(machine())
    if chosen.json:
        chosen.json.write_text(json.dumps([asdict(row) for row in rows], indent=2) + "\n", "utf-8")
    return int(any(row.wrong for row in rows))


if __name__ == "__main__":
    sys.exit(main())
