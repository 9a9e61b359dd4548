"""A run's learning curve as a picture, from its `episodes.jsonl`."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from common import palette
from common.errors import CheckpointError, ConfigError
from common.system.extras import optional
from learner.run.episodes import read_episodes

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
    if not episodes.is_file():
        raise CheckpointError(f"{episodes} does not exist: name a run that has begun with --run")
    rows = [values for values, _ in read_episodes(episodes)]
    if not rows:
        raise CheckpointError(f"{episodes} has no finished episode yet: wait for the first")
    began = float(rows[0]["time"])
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


def plot_run(
    folder: Path, out: Path, lines: Mapping[str, float], *, over: Over = "minutes", window: int = TRAINING_WINDOW
) -> Curve:
    """Draw distance and success over time or updates, and return the curve of evaluation.

    Args:
        folder: of the run.
        out: picture to write; its ending decides the format.
        lines: yardsticks by name, metres, drawn across the picture of the distance.
        over: what the curves run over; updates leave out the pauses of a run that was resumed.
        window: episodes behind each point of training.

    Raises:
        CheckpointError: the run has no finished episode.
        ConfigError: matplotlib is not installed, or does not know the format.
    """
    with optional("a plot", "plots"):
        from matplotlib.figure import Figure

    training, evaluation = read_curves(folder / "episodes.jsonl", window)
    figure = Figure(figsize=(8.0, 5.6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    for curve, style in (
        (training, {"color": palette.CURVE_BEHIND.light, "label": "training, sampled actions", "marker": ""}),
        (evaluation, {}),
    ):
        label = {"color": palette.CURVE.light, "marker": "o", "markersize": 3} | style
        label.setdefault("label", "validation worlds, greedy")
        along = curve.minutes if over == "minutes" else curve.updates
        if len(along):
            above.plot(along, curve.distance, **label)
            below.plot(along, 100.0 * curve.success, **label)
    for i, (name, metres) in enumerate(lines.items()):
        above.axhline(metres, color=palette.YARDSTICK.light, linestyle=["--", ":", "-."][i % 3], linewidth=1.0)
        above.annotate(
            f"{name} {metres:.0f} m", (1.0, metres), xycoords=("axes fraction", "data"), ha="right", va="bottom"
        )
    above.set_ylabel("distance per episode (m)")
    above.set_ylim(bottom=0.0)
    below.set_ylabel("completed (%)")
    below.set_ylim(-3, 103)
    below.set_xlabel(_OVER[over])
    if len(training.minutes) or len(evaluation.minutes):
        above.legend(loc="best", frameon=False)
    above.set_title(f"run {folder.name}")
    for axes in (above, below):
        axes.grid(alpha=0.3)
    out.parent.mkdir(parents=True, exist_ok=True)
    try:
        figure.savefig(out, dpi=110)
    except ValueError as error:
        raise ConfigError(f"cannot write {out}: {error}") from error
    return evaluation


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
