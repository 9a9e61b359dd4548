"""Statistics of planners and paired comparisons: how much better, and whether the difference is significant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from actors.evaluation.results import Results, ResultsError
from common.system.extras import optional

RESAMPLES = 9_999
CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class Summary:
    """What one planner did, over its episodes; failures count with their distance so far.

    Attributes:
        planner: name.
        episodes: number.
        mean: distance, metres.
        std: standard deviation over the maps (map variety, not uncertainty), metres; nan for a single map.
        success: share of completed episodes.
        steps: mean number of decisions.
        explored: mean share of the reachable free area that was seen.
        median_ms: median over the episodes of the median decision time.
        p95_ms: median over the episodes of the 95th percentile of the decision time.
    """

    planner: str
    episodes: int
    mean: float
    std: float
    success: float
    steps: float
    explored: float
    median_ms: float
    p95_ms: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """One planner against another on the maps that both have.

    Attributes:
        maps: number of maps.
        failures: of these, where one of both failed.
        ratio: mean distance of the planner over that of the other.
        difference: mean paired difference, metres; negative is better than the other.
        low: lower end of the 95 % bootstrap interval of the ratio.
        high: upper end.
        t_p: two-sided p of the paired t-test.
        wilcoxon_p: two-sided p of Wilcoxon's signed-rank test.
    """

    maps: int
    failures: int
    ratio: float
    difference: float
    low: float
    high: float
    t_p: float
    wilcoxon_p: float


def summarise(results: Results) -> Summary:
    """Return the figures of one results file; `ResultsError` when it has no episode."""
    episodes = results.episodes
    if not episodes:
        raise ResultsError(f"the results of {results.planner!r} hold no episode: run it again")
    distances = np.array([episode.distance_m for episode in episodes])
    # An episode without a decision, or one that crashed, has no decision time.
    times = [episode.decision_ms for episode in episodes if episode.decision_ms.p95 > 0.0]
    return Summary(
        planner=results.planner,
        episodes=len(episodes),
        mean=float(distances.mean()),
        std=float(distances.std(ddof=1)) if len(distances) > 1 else float("nan"),
        success=float(np.mean([episode.success for episode in episodes])),
        steps=float(np.mean([episode.steps for episode in episodes])),
        explored=float(np.mean([episode.explored_rate for episode in episodes])),
        median_ms=float(np.median([time.median for time in times])) if times else float("nan"),
        p95_ms=float(np.median([time.p95 for time in times])) if times else float("nan"),
    )


def paired_distances(results: Results, other: Results) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """Return both distances on the maps that both have, metres, in the order of the first, and the failures there.

    Raises:
        ResultsError: they have no map in common.
    """
    theirs = {episode.map: episode for episode in other.episodes}
    pairs = [(episode, theirs[episode.map]) for episode in results.episodes if episode.map in theirs]
    if not pairs:
        raise ResultsError(
            f"{results.planner!r} and {other.planner!r} have no map in common: run both with the same --maps"
        )
    a = np.array([episode.distance_m for episode, _ in pairs])
    b = np.array([episode.distance_m for _, episode in pairs])
    return a, b, sum(not (one.success and two.success) for one, two in pairs)


def distance_ratio(results: Results, other: Results) -> float:
    """Return the mean distance over that of another planner, on the maps that both have; nan if that never moved."""
    a, b, _ = paired_distances(results, other)
    return float(a.sum() / b.sum()) if b.any() else float("nan")


def compare(results: Results, baseline: Results, *, resamples: int = RESAMPLES) -> Comparison:
    """Compare a planner with a baseline, map by map.

    Args:
        results: of the planner.
        baseline: of the other one.
        resamples: of the bootstrap; its chance is seeded, so equal files give equal intervals.

    Raises:
        ResultsError: they have no map in common.
        ConfigError: SciPy is not installed.
    """
    a, b, failures = paired_distances(results, baseline)
    difference = a - b
    if not b.any():
        raise ResultsError(f"the baseline {baseline.planner!r} never moved: choose another one")
    low, high = _bootstrap_ratio(a, b, resamples)
    t_p, wilcoxon_p = _tests(difference)
    return Comparison(
        maps=len(a),
        failures=failures,
        ratio=float(a.sum() / b.sum()),
        difference=float(difference.mean()),
        low=low,
        high=high,
        t_p=t_p,
        wilcoxon_p=wilcoxon_p,
    )


def group_means(results: Results) -> dict[str, float]:
    """Return the mean distance by folder of the maps' names, metres; empty where names have no folder."""
    groups: dict[str, list[float]] = {}
    for episode in results.episodes:
        folder, slash, _ = episode.map.rpartition("/")
        if slash:
            groups.setdefault(folder, []).append(episode.distance_m)
    return {folder: float(np.mean(distances)) for folder, distances in groups.items()}


def find(found: Sequence[Results], planner: str) -> Results:
    """Return the results of a planner; `ResultsError` when there are none."""
    for results in found:
        if results.planner == planner:
            return results
    names = ", ".join(results.planner for results in found)
    raise ResultsError(f"there are no results of planner {planner!r}, only of {names}")


def _tests(difference: NDArray[np.float64]) -> tuple[float, float]:
    """Return the p values of the paired t-test and of Wilcoxon's test; nan for fewer than two maps."""
    if len(difference) < 2:
        return float("nan"), float("nan")
    if np.ptp(difference) == 0.0:
        # Equal differences everywhere have no spread to test against; no difference at all is no evidence.
        return (1.0, 1.0) if difference[0] == 0.0 else (0.0, _wilcoxon(difference))
    return float(_scipy_stats().ttest_1samp(difference, 0.0).pvalue), _wilcoxon(difference)


def _wilcoxon(difference: NDArray[np.float64]) -> float:
    return float(_scipy_stats().wilcoxon(difference, zero_method="zsplit").pvalue)


def _bootstrap_ratio(a: NDArray[np.float64], b: NDArray[np.float64], resamples: int) -> tuple[float, float]:
    """Return the percentile interval of sum(a) / sum(b) over resampled maps; nan for fewer than two maps."""
    if len(a) < 2:
        return float("nan"), float("nan")
    stats = _scipy_stats()

    def ratio(x: NDArray[np.float64], y: NDArray[np.float64], axis: int = -1) -> NDArray[np.float64]:
        return np.asarray(x.sum(axis=axis) / np.maximum(y.sum(axis=axis), 1e-9))

    found = stats.bootstrap(
        (a, b),
        ratio,
        paired=True,
        vectorized=True,
        n_resamples=resamples,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng(0),
        batch=1_000,
    )
    return float(found.confidence_interval.low), float(found.confidence_interval.high)


def _scipy_stats() -> ModuleType:
    with optional("a comparison", "plots", instead="leave --baseline out"):
        from scipy import stats

    return stats
