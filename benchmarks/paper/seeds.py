"""Results of one planner that was trained several times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from actors.evaluation.results import Results
from benchmarks.paper.plan import SEEDS


def same_planner(found: Sequence[Results], label: str) -> list[Results]:
    """Return the results of a label, or those of all its seeds that are done."""
    named = [results for results in found if results.planner == label]
    return named or _of_seeds(found, label)


def seeds_done(found: Sequence[Results], label: str) -> int:
    """Return how many seeds of a trained planner are done; 0 for one that is not trained."""
    return len(_of_seeds(found, label))


def mean_of_seeds(found: Sequence[Results], label: str) -> Results | None:
    """Return the results of a label, with the mean distance of its seeds on each map; None without any."""
    same = same_planner(found, label)
    if len(same) < 2:
        return same[0] if same else None
    distances = [{episode.map: episode.distance_m for episode in results.episodes} for results in same]
    episodes = [
        episode.model_copy(update={"distance_m": float(np.mean([each[episode.map] for each in distances]))})
        for episode in same[0].episodes
        if all(episode.map in each for each in distances)
    ]
    return same[0].model_copy(update={"planner": label, "episodes": episodes})


def _of_seeds(found: Sequence[Results], label: str) -> list[Results]:
    labels = {f"{label}-{seed}" for seed in SEEDS}
    return [results for results in found if results.planner in labels]
