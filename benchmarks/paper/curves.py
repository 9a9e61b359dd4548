"""Learning curves: checkpoints of a training drive in the same validation worlds: has it levelled off?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from actors.evaluation.results import Results
from actors.evaluation.statistics import compare, summarise
from actors.evaluation.table import number, render
from benchmarks.paper.plan import IMITATION, MAPS, UPDATES, Task

AT: Final = tuple(range(IMITATION, UPDATES + 1, 600))
"""Updates at which a curve has points: the end of imitation, and thirds of what follows."""
WORLDS: Final = 60
"""Of the validation part of the public training maps, which no training has seen."""


def options(task: Task) -> tuple[str, ...]:
    """Return the options of `hd-eval run` for the worlds of a curve, with ``{maps}`` in them."""
    return ("--task", task, "--maps", f"{MAPS}/{task}/train#validation", "--limit", str(WORLDS))


def label(updates: int) -> str:
    """Return what the results of a point are called."""
    return f"updates-{updates}"


def nearest_checkpoint(run: Path, updates: int) -> str | None:
    """Return the checkpoint of a run that is nearest to a number of updates; None where the run has none."""
    names = [folder.name for folder in (run / "checkpoints").glob("[0-9]*")]
    return min(names, key=lambda name: abs(int(name) - updates), default=None)


def curves(kept: Mapping[str, Sequence[Results]]) -> str:
    """Return curves as Markdown: mean travel, and what the last third of the updates after imitation was worth.

    Args:
        kept: by training, the results of its points in the order of `AT`.
    """
    titles = ["training", *(f"{at:,} [px]" for at in AT), f"{AT[-1]:,} / {AT[-2]:,}", "95 % interval"]
    cells = []
    for name, points in kept.items():
        means = [number(summarise(point).mean / point.metres_per_pixel, 1) for point in points]
        gain = compare(points[-1], points[-2])
        cells.append([name, *means, f"{gain.ratio:.3f}", f"{gain.low:.3f} to {gain.high:.3f}"])
    return render(titles, cells, "markdown").strip() if cells else ""
