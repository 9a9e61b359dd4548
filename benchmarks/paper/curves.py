"""Learning curves: checkpoints of a training drive in the same validation worlds: has it levelled off?"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from actors.evaluation.results import Results
from actors.evaluation.statistics import compare, summarise
from actors.evaluation.table import number, render
from benchmarks.paper.plan import IMITATION, MAPS, UPDATES, Task

AT: Final = tuple(range(IMITATION, UPDATES + 1, 600))
"""Updates at which a curve has points: the end of imitation, and thirds of what follows."""
NEAR: Final = 200
"""A checkpoint may be so many updates away from its point: they are written by the clock."""
WORLDS: Final = 60
"""Of the validation part of the public training maps, which no training has seen."""


def options(task: Task) -> tuple[str, ...]:
    """Return the options of `hd-eval run` for the worlds of a curve, with ``{maps}`` in them."""
    return ("--task", task, "--maps", f"{MAPS}/{task}/train#validation", "--limit", str(WORLDS))


def label(updates: int) -> str:
    """Return what the results of a point are called."""
    return f"updates-{updates}"


def checkpoint_at(run: Path, updates: int) -> str | None:
    """Return the checkpoint of a run that is nearest to a number of updates; None where none is near."""
    names = [folder.name for folder in (run / "checkpoints").glob("[0-9]*")]
    nearest = min(names, key=lambda name: abs(int(name) - updates), default=None)
    return nearest if nearest is not None and abs(int(nearest) - updates) <= NEAR else None


def curves(kept: Mapping[str, Mapping[int, Results]]) -> str:
    """Return curves as Markdown: mean travel, and what the last third of the updates after imitation was worth.

    Args:
        kept: by training, the results of its points, by updates; those without a checkpoint are missing.
    """
    titles = ["training", *(f"{at:,} [px]" for at in AT), f"{AT[-1]:,} / {AT[-2]:,}", "95 % interval"]
    cells = [[name, *(_mean(points.get(at)) for at in AT), *_gain(points)] for name, points in kept.items()]
    return render(titles, cells, "markdown").strip() if cells else ""


def _mean(point: Results | None) -> str:
    return "-" if point is None else number(summarise(point).mean / point.metres_per_pixel, 1)


def _gain(points: Mapping[int, Results]) -> tuple[str, str]:
    """Return the ratio of the last two points, and its interval."""
    if AT[-1] not in points or AT[-2] not in points:
        return "-", ""
    gain = compare(points[AT[-1]], points[AT[-2]])
    return f"{gain.ratio:.3f}", f"{gain.low:.3f} to {gain.high:.3f}"
