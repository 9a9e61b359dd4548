"""What came of each fault, as a table."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass

from rich import box
from rich.table import Table

TITLES = "name", "fault", "expected", "seen", "acknowledged", "lost", "doubled", "resumes after", "", "commit"


@dataclass(frozen=True, slots=True)
class Row:
    """What came of a fault.

    Attributes:
        fault: in words.
        expected: what had to be seen.
        seen: what was seen.
        acknowledged: messages by the end of the fault; None where nothing was to be delivered.
        lost: acknowledged messages that are not in the run, of those that nobody damaged.
        doubled: steps and episodes that the run counts beyond what it was sent.
        resumes: seconds until the next acknowledgement; None where delivery was not interrupted.
        wrong: what was not as it should be; empty when nothing.
        name: that the fault is chosen by.
        commit: of the code that it was tried on.
    """

    fault: str
    expected: str
    seen: str
    acknowledged: int | None = None
    lost: int = 0
    doubled: int = 0
    resumes: float | None = None
    wrong: str = ""
    name: str = ""
    commit: str = ""

    def cells(self) -> tuple[str, ...]:
        """Return the row as texts."""
        return (
            self.name,
            self.fault,
            self.expected,
            self.seen,
            "" if self.acknowledged is None else f"{self.acknowledged:,}",
            str(self.lost),
            str(self.doubled),
            "" if self.resumes is None else f"{self.resumes:.1f} s",
            self.wrong or "right",
            self.commit,
        )


def table(rows: Sequence[Row]) -> Table:
    """Show what came of all faults in a terminal."""
    found = Table(box=box.SIMPLE)
    for title in TITLES[1:-1]:
        found.add_column(title)
    for row in rows:
        found.add_row(*row.cells()[1:-1])
    return found


def merged(page: str, rows: Sequence[Row], order: Sequence[str]) -> str:
    """Return the lines of a page's table with some rows in the place of those of the same names.

    Args:
        page: lines of the table as it is; empty at first.
        rows: fresh ones.
        order: of the names.
    """
    lines = {line.split("|")[1].strip(): line for line in page.splitlines()[2:] if line.startswith("|")}
    lines |= {row.name: _line(row.cells()) for row in rows}
    return "\n".join([_line(TITLES), _line(("---",) * len(TITLES)), *(lines[name] for name in order if name in lines)])


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |"


def machine() -> str:
    """Describe this machine at this moment."""
    load = os.getloadavg()[0]
    return f"{platform.machine()}, {os.cpu_count()} cores, load {load:.1f}, Python {platform.python_version()}"
