"""A run's learning curve as a picture, from its `episodes.jsonl`."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from common import palette
from common.errors import CheckpointError, ConfigError
from common.system.extras import optional
from learner.run.episodes import read_episodes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TRAINING_WINDOW = 50
LEAST_WINDOW = 10
"""Fewer episodes make no point of the training curve."""

Over = Literal["minutes", "updates"]
_OVER: dict[Over, str] = {"minutes": "minutes since the first episode", "updates": "updates"}


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Figures over the time of a run; all arrays have one entry per point.

    Attributes:
        minutes: since the first finished episode.
        updates: behind the policy.
        distance: mean travelled metres.
        success: share of completed episodes, 0 to 1.
        number: episodes behind the point.
    """

    minutes: NDArray[np.float64]
    updates: NDArray[np.float64]
    distance: NDArray[np.float64]
    success: NDArray[np.float64]
    number: NDArray[np.int64]


def read_curves(episodes: Path, window: int = TRAINING_WINDOW) -> tuple[Curve, Curve]:
    """Return the curves of training and of evaluation.

    Training is the mean of the last ``window`` episodes that the policy drove; evaluation has one point per complete
    round of one version.

    Raises:
        CheckpointError: the file is missing or has no episode.
    """
    rows = _read(episodes)
    return _curves(rows, float(rows[0]["time"]), window)


def read_family_curves(episodes: Path, window: int = TRAINING_WINDOW) -> dict[str, tuple[Curve, Curve]]:
    """Return the curves of training and of evaluation of each family of worlds, by its name.

    Raises:
        CheckpointError: the file is missing or has no episode.
    """
    rows = _read(episodes)
    families: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        # Records of releases before there were families have none.
        families[row.get("family", "worlds")].append(row)
    return {name: _curves(families[name], float(rows[0]["time"]), window) for name in sorted(families)}


def plot_run(
    folder: Path,
    out: Path,
    lines: Mapping[str, float],
    *,
    over: Over = "minutes",
    window: int = TRAINING_WINDOW,
    by_family: bool = False,
) -> Curve:
    """Draw distance and success over time or updates, and return the curve of evaluation.

    Args:
        folder: of the run.
        out: picture to write; its ending decides the format.
        lines: yardsticks by name, metres, drawn across the picture of the distance.
        over: what the curves run over; updates leave out the pauses of a run that was resumed.
        window: episodes behind each point of training.
        by_family: one picture for each family of worlds, beside one another.

    Raises:
        CheckpointError: the run has no finished episode, or too few for a point.
        ConfigError: matplotlib is not installed, or does not know the format.
    """
    with optional("a plot", "plots"):
        from matplotlib.figure import Figure

    episodes = folder / "episodes.jsonl"
    whole = read_curves(episodes, window)
    if not any(len(curve.updates) for curve in whole):
        raise CheckpointError(
            f"{episodes} holds too little for a curve: expected {LEAST_WINDOW} training episodes that the policy drove "
            "or one of evaluation: wait for them"
        )
    panels = read_family_curves(episodes, window) if by_family else {f"run {folder.name}": whole}
    columns = ceil(sqrt(len(panels)))
    rows = ceil(len(panels) / columns)
    width, height = (8.0, 5.6) if len(panels) == 1 else (4.2 * columns, 3.6 * rows)
    figure = Figure(figsize=(width, height), layout="constrained")
    places = figure.subfigures(rows, columns, squeeze=False).reshape(-1)
    end = max(float(_along(curve, over)[-1]) for curve in whole if len(curve.updates))
    explained = False
    for place, (title, curves) in zip(places, panels.items(), strict=False):
        above, below = place.subplots(2, 1, sharex=True, height_ratios=[2, 1])
        above.set_title(title)
        _draw_lines(above, lines)
        _draw(above, below, *curves, over)
        # Families are seen side by side only where their curves run over the same.
        below.set_xlim(0.0, 1.02 * max(end, 1.0))
        if place is places[0]:
            above.set_ylabel("distance per episode (m)")
            below.set_ylabel("completed (%)")
        if not above.get_legend_handles_labels()[0]:
            above.text(0.5, 0.5, "too few episodes yet", transform=above.transAxes, ha="center", va="center")
        elif not explained:
            above.legend(loc="best", frameon=False)
            explained = True
    out.parent.mkdir(parents=True, exist_ok=True)
    try:
        figure.savefig(out, dpi=110)
    except ValueError as error:
        raise ConfigError(f"cannot write {out}: {error}") from error
    return whole[1]


def _draw(above: Axes, below: Axes, training: Curve, evaluation: Curve, over: Over) -> None:
    """Draw one pair of curves: the distance above, what was completed below."""
    for curve, style in (
        (training, {"color": palette.CURVE_BEHIND.light, "label": "training, sampled actions"}),
        (
            evaluation,
            {"color": palette.CURVE.light, "label": "validation worlds, greedy", "marker": "o", "markersize": 3},
        ),
    ):
        along = _along(curve, over)
        if len(along):
            # A line of one point is none.
            shown = style | {"marker": "o", "markersize": 3} if len(along) == 1 else style
            above.plot(along, curve.distance, **shown)
            below.plot(along, 100.0 * curve.success, **shown)
    above.set_ylim(bottom=0.0)
    below.set_ylim(-3, 103)
    below.set_xlabel(_OVER[over])
    for axes in (above, below):
        axes.grid(alpha=0.3)


def _along(curve: Curve, over: Over) -> NDArray[np.float64]:
    return curve.minutes if over == "minutes" else curve.updates


def _draw_lines(axes: Axes, lines: Mapping[str, float]) -> None:
    """Draw yardsticks across a picture of the distance."""
    for i, (name, metres) in enumerate(lines.items()):
        axes.axhline(metres, color=palette.YARDSTICK.light, linestyle=["--", ":", "-."][i % 3], linewidth=1.0)
        axes.annotate(
            f"{name} {metres:.0f} m", (1.0, metres), xycoords=("axes fraction", "data"), ha="right", va="bottom"
        )


def _read(episodes: Path) -> list[dict[str, Any]]:
    if not episodes.is_file():
        raise CheckpointError(f"{episodes} does not exist: name a run that has begun with --run")
    rows = [values for values, _ in read_episodes(episodes)]
    if not rows:
        raise CheckpointError(f"{episodes} has no finished episode yet: wait for the first")
    return rows


def _curves(rows: list[dict[str, Any]], began: float, window: int) -> tuple[Curve, Curve]:
    training = [row for row in rows if row["role"] == "train" and row["driver"] == "policy"]
    points = [
        _point(training[max(0, i + 1 - window) : i + 1], began)
        for i in range(min(LEAST_WINDOW - 1, len(training)), len(training))
    ]
    rounds: dict[tuple[str, int], list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        if row["role"] == "evaluate":
            rounds[row["actor"], row["version"]].append(row)
    largest = max((len(group) for group in rounds.values()), default=0)
    whole = [group for group in rounds.values() if len(group) == largest]
    return _curve(points), _curve([_point(group, began) for group in whole])


def _point(rows: list[dict[str, Any]], began: float) -> tuple[float, float, float, float, int]:
    last = rows[-1]
    return (
        (float(last["time"]) - began) / 60.0,
        float(last["updates"]),
        float(np.mean([row["distance"] for row in rows])),
        float(np.mean([row["success"] for row in rows])),
        len(rows),
    )


def _curve(points: list[tuple[float, float, float, float, int]]) -> Curve:
    table = np.array(points, dtype=np.float64).reshape(-1, 5)
    return Curve(table[:, 0], table[:, 1], table[:, 2], table[:, 3], table[:, 4].astype(np.int64))
