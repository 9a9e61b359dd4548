"""A record of measured figures: one JSON file that says on which machine and at which commit they were measured."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from common.errors import ConfigError
from common.system.code_state import code_state, commit_of

# What a figure is compared with, both from the same run: such ratios say more about the code than about the machine.
RATIOS: Final[Mapping[str, tuple[str, str, str]]] = {
    "a decision with cells of 0.1 m over 0.25 m": (
        "decision_step",
        "decision_step.0.1m.decision_ms",
        "decision_step.0.25m.decision_ms",
    ),
    "the policy through torch over compiled kernels, d 64": (
        "inference",
        "inference/small/torch_ms",
        "inference/small/decision_ms",
    ),
    "the policy through torch over compiled kernels, d 128": (
        "inference",
        "inference/paper/torch_ms",
        "inference/paper/decision_ms",
    ),
    "updates in bf16 over fp32, d 64": ("updates", "updates/small/bf16/sac_per_s", "updates/small/fp32/sac_per_s"),
    "updates on the reduced graph over the whole one, d 64": (
        "updates",
        "updates/small/fp32_reduced/sac_per_s",
        "updates/small/fp32/sac_per_s",
    ),
    "updates in bf16 over fp32, d 128": ("updates", "updates/paper/bf16/sac_per_s", "updates/paper/fp32/sac_per_s"),
    "updates on the reduced graph over the whole one, d 128": (
        "updates",
        "updates/paper/fp32_reduced/sac_per_s",
        "updates/paper/fp32/sac_per_s",
    ),
    "a scan of PyBullet over `grid`": ("simulators", "kinematic_scan_ms", "grid_scan_ms"),
    "decoding a chunk over encoding it": ("ingest", "decode_and_check_us", "encode_us"),
}
"""What the ratio is, then the part, the figure above and the figure below the line."""


@dataclass(frozen=True, slots=True)
class Record:
    """What one run of the benchmarks measured.

    Attributes:
        machine: processor, cores, Python and load when the run began.
        commit: of the code, with a mark when files differed from it.
        short: whether the parts were small, so that the figures say only that they can be measured.
        figures: by part and name.
        ratios: of the figures, by what they compare.
    """

    machine: str
    commit: str
    short: bool
    figures: dict[str, dict[str, float]]
    ratios: dict[str, float]

    @classmethod
    def of(cls, figures: dict[str, dict[str, float]], load: float, *, short: bool = False) -> Record:
        """Make the record of figures that this machine has just measured."""
        machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, load {load:.1f}"
        return cls(machine, commit_of(code_state()), short, figures, ratios(figures))

    def write(self, path: Path) -> None:
        """Write it as JSON."""
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(asdict(self), indent=2) + "\n", "utf-8")

    @classmethod
    def read(cls, path: Path) -> Record:
        """Read what `write` wrote.

        Raises:
            ConfigError: there is no such file, or it holds something else.
        """
        try:
            return cls(**json.loads(path.read_text("utf-8")))
        except (OSError, ValueError, TypeError) as error:
            raise ConfigError(f"{path}: expected a file of `make bench`, got {error}") from None


def ratios(figures: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """Return the ratios whose figures were measured."""
    found = {}
    for name, (part, above, below) in RATIOS.items():
        held = figures.get(part, {})
        if held.get(below) and above in held:
            found[name] = held[above] / held[below]
    return found


@dataclass(frozen=True, slots=True)
class Change:
    """A figure of two records.

    Attributes:
        part: of the benchmarks.
        name: of the figure.
        before: in the first record, None when it has none.
        after: in the second, likewise.
    """

    part: str
    name: str
    before: float | None
    after: float | None

    @property
    def factor(self) -> float | None:
        """After over before; None where one is missing or nothing can be divided by."""
        return self.after / self.before if self.before and self.after is not None else None


def changes(before: Record, after: Record) -> Iterator[Change]:
    """Yield every figure and ratio of either record, in their order."""
    first = {**before.figures, "ratios": before.ratios}
    second = {**after.figures, "ratios": after.ratios}
    for part in dict.fromkeys((*first, *second)):
        mine, theirs = first.get(part, {}), second.get(part, {})
        for name in dict.fromkeys((*mine, *theirs)):
            yield Change(part, name, mine.get(name), theirs.get(name))


def number(value: float | None) -> str:
    """Write a figure with about three digits."""
    if value is None:
        return ""
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


def markdown(record: Record, titles: Mapping[str, str]) -> str:
    """Return a record as a table of a page.

    Args:
        record: what was measured.
        titles: what each part measures.
    """
    lines = [
        f"Machine: {record.machine}; commit {record.commit[:9]}.",
        "",
        "| part | what | measured |",
        "| --- | --- | --- |",
    ]
    for part, figures in record.figures.items():
        lines += _rows(titles.get(part, part), figures)
    return "\n".join([*lines, *_rows("ratios within the run", record.ratios)])


def _rows(title: str, figures: Mapping[str, float]) -> Sequence[str]:
    return [
        f"| {title if not place else ''} | {name} | {number(value)} |"
        for place, (name, value) in enumerate(figures.items())
    ]
