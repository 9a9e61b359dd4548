"""What changed between two runs of the benchmarks: ``make bench-compare A=OLD.json B=NEW.json``.

Figures that differ by less than 10 % are only counted: a shared machine differs by as much from one minute to the
next. Compare runs of one machine at about the same load; the ratios within a run bear other machines better.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from rich.table import Table

from benchmarks.record import Record, changes, number
from common.cli import output_console
from common.errors import ConfigError

_NOTABLE: Final = 0.10


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the figures that changed, the largest changes first."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path, help="file of an earlier `make bench`")
    parser.add_argument("after", type=Path, help="file of a later one")
    chosen = parser.parse_args(arguments)
    try:
        before, after = Record.read(chosen.before), Record.read(chosen.after)
    except ConfigError as error:
        parser.error(str(error))
    console = output_console()
    for label, record in (("before", before), ("after", after)):
        short = ", measured in short: only whether it can be measured" if record.short else ""
        console.print(f"{label}: {record.commit[:9]} on {record.machine}{short}")
    every = list(changes(before, after))
    factors = [(each, each.factor) for each in every]
    moved = [(each, factor) for each, factor in factors if factor and max(factor, 1.0 / factor) >= 1.0 + _NOTABLE]
    table = Table("part", "figure", "before", "after", "after / before", box=None)
    for each, factor in sorted(moved, key=lambda pair: -max(pair[1], 1.0 / pair[1])):
        table.add_row(each.part, each.name, number(each.before), number(each.after), f"{factor:.2f}")
    for each, factor in factors:
        if factor is None:
            table.add_row(each.part, each.name, number(each.before), number(each.after), "")
    console.print(table)
    same = len(every) - len(moved) - sum(factor is None for _, factor in factors)
    console.print(f"{same} of {len(every)} figures differ by less than {_NOTABLE:.0%}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
