"""The table of an evaluation at a large scale."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from actors.evaluation.large.results import LargeEpisode, LargeResults, settings_of
from actors.evaluation.results import ResultsError
from actors.evaluation.statistics import compare, find, summarise
from actors.evaluation.table import Rows, number
from common.tasks import find_task


def make_rows(found: Sequence[LargeResults], baseline: str | None) -> tuple[list[str], Rows]:
    """Return the titles and the rows of the table, one row per planner: mean ± standard deviation over the worlds.

    Args:
        found: results of all planners, of one task.
        baseline: planner to compare distances with, None for none.

    Raises:
        ResultsError: the baseline is not among the results, or worlds do not match.
    """
    plain = [results.plain() for results in found]
    reference = None if baseline is None else find(plain, baseline)
    touring = find_task(found[0].task).needs_target
    titles = ["planner", "tours" if touring else "worlds", "success"]
    titles += ["targets"] if touring else ["explored"]
    titles += ["distance [m]", "time [s]", "median [ms]", "p95 [ms]"]
    titles += [] if touring else ["volume [m³]", "volume / distance [m³/m]"]
    titles.append("collisions / km")
    if reference is not None:
        titles += [f"distance / {baseline}", "95 % interval"]
    rows = []
    for results, each in zip(found, plain, strict=True):
        summary = summarise(each)
        episodes = results.episodes
        row = [results.planner, str(summary.episodes), f"{100 * summary.success:.0f} %"]
        if touring:
            legs = [leg for episode in episodes for leg in episode.legs]
            row.append(f"{sum(leg.success for leg in legs)} of {len(legs)}")
        else:
            row.append(f"{100 * summary.explored:.1f} %")
        row += [
            _spread(episodes, lambda episode: episode.distance_m),
            _spread(episodes, lambda episode: episode.time_s),
        ]
        row += [number(summary.median_ms, 2), number(summary.p95_ms, 2)]
        if not touring:
            row.append(_spread(episodes, lambda episode: episode.volume_m3))
            row.append(_spread(episodes, lambda episode: episode.volume_per_metre, 2))
        travelled = sum(episode.distance_m for episode in episodes)
        touched = sum(episode.collisions for episode in episodes)
        row.append(number(1e3 * touched / travelled if travelled else math.nan, 1))
        if reference is not None:
            row += ["1", ""]
            if each is not reference:
                against = compare(each, reference)
                row[-2:] = [number(against.ratio, 3), _interval(against.low, against.high)]
        rows.append(row)
    return titles, rows


def notes(found: Sequence[LargeResults], baseline: str | None) -> list[str]:
    """Return what a reader of the table has to know, in sentences."""
    first = found[0]
    settings = settings_of(first)
    lidar = settings.simulator
    lines = [
        f"Mean ± standard deviation over the worlds of {settings.maps[0]} (their variety, not an uncertainty); "
        "failures count with the values reached so far.",
        f"Robot at {lidar.speed:g} m/s, lidar of {lidar.lidar_layers} x {lidar.rays} rays at {lidar.lidar_rate:g} Hz "
        f"and {settings.mapping.sensor_range:g} m; planners leave its centre {settings.mapping.robot_radius:g} m.",
        "Time: simulated driving, computing excluded. Decision: processor time with mapping, median over the worlds of "
        "their medians and of their 95th percentiles.",
    ]
    if any(settings_of(results).mapping.robot_radius != settings.mapping.robot_radius for results in found):
        raise ResultsError("results of several mapping.robot_radius do not go into one table: make one of each")
    for results in found:
        failed = [(episode.map, episode.reason) for episode in results.episodes if not episode.success]
        if failed:
            lines.append(f"Failures of {results.planner}: " + "; ".join(f"{name}: {why}" for name, why in failed) + ".")
    if len({frozenset(episode.map for episode in results.episodes) for results in found}) > 1:
        lines.append("Not all planners have done the same worlds.")
    if baseline is not None:
        lines.append(f"Ratios are paired by world with {baseline}; interval: bootstrap over worlds, 9,999 resamples.")
    commits = list(dict.fromkeys(results.commit for results in found))
    lines.append(f"Commit {'; '.join(commits)}; seed {', '.join(sorted({str(results.seed) for results in found}))}.")
    return lines


def _spread(episodes: Sequence[LargeEpisode], figure: Callable[[LargeEpisode], float], places: int = 0) -> str:
    values = np.array([figure(episode) for episode in episodes])
    if len(values) < 2:
        return number(float(values.mean()), places)
    return f"{values.mean():.{places}f} ± {values.std(ddof=1):.{places}f}"


def _interval(low: float, high: float) -> str:
    return "-" if math.isnan(low) else f"{low:.3f} to {high:.3f}"
