"""Plots of an evaluation: trajectories over the belief, coverage against distance, box plots, paired scatter."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actors.evaluation.pixels import to_pixels
from actors.evaluation.results import Results, ResultsError
from actors.evaluation.retrace import retrace
from actors.evaluation.settings import EvaluationSettings
from actors.evaluation.statistics import distance_ratio, find
from actors.maps.grid_map import GridMap
from common import palette
from common.mapping.belief import Belief
from common.system.extras import optional
from common.tasks import find_task

# Unknown, free and occupied cells of a belief, and true walls that the robot has not seen.
UNKNOWN, FREE = palette.UNKNOWN.rgb, palette.FREE.rgb
OCCUPIED, UNSEEN_WALL = palette.OCCUPIED.rgb, palette.UNSEEN_WALL.rgb
CURVE_POINTS = 200
PANEL_WIDTH = 4.2


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """What a route showed, for drawing; all positions in pixels of the image.

    Attributes:
        picture: belief at the end, uint8, shape (rows, columns, 3), row 0 at the top.
        frontiers: shape (n, 2).
        beacons: shape (m, 2).
        distance: travelled metres at each waypoint.
        explored: share of the reachable free area seen at each waypoint.
    """

    picture: NDArray[np.uint8]
    frontiers: NDArray[np.float64]
    beacons: NDArray[np.float64]
    distance: NDArray[np.float64]
    explored: NDArray[np.float64]


def trace(results: Results, map_name: str, world: GridMap, settings: EvaluationSettings) -> Trace:
    """Drive the route of one episode again; `ResultsError` when there is none on that map."""
    episode = next((episode for episode in results.episodes if episode.map == map_name), None)
    if episode is None:
        raise ResultsError(f"the results of {results.planner!r} have no map {map_name!r}")
    mapping = settings.mapping.model_copy(update={"sensor_range": results.sensor_range_m})
    distance, explored = [], []
    for moment in retrace(
        world, episode.waypoints, mapping, settings.simulator, navigation=find_task(results.task).needs_target
    ):
        distance.append(moment.distance)
        explored.append(moment.coverage.explored)
    mapper = moment.mapper
    return Trace(
        picture=belief_picture(mapper.belief, world),
        frontiers=_in_pixels(world, mapper.frontiers),
        beacons=_in_pixels(world, mapper.beacons) if not mapper.stuck else np.zeros((0, 2)),
        distance=np.array(distance),
        explored=np.array(explored),
    )


def belief_picture(belief: Belief, world: GridMap) -> NDArray[np.uint8]:
    """Draw a belief in the pixels of a map's image, uint8, shape (rows, columns, 3); row 0 is the top."""
    rows, columns = world.free.shape
    x = world.origin[0] + (np.arange(columns) + 0.5) * world.resolution
    y = world.origin[1] + (np.arange(rows) + 0.5) * world.resolution
    left, low = belief.origin
    column = np.clip(np.floor((x - left) / belief.resolution + 1e-9).astype(np.int64), 0, belief.shape[1] - 1)
    row = np.clip(np.floor((y - low) / belief.resolution + 1e-9).astype(np.int64), 0, belief.shape[0] - 1)
    cells = belief.cells[row[:, None], column[None, :]]
    picture = np.empty((rows, columns, 3), dtype=np.uint8)
    picture[:] = UNKNOWN
    picture[(cells < 0) & ~world.free] = UNSEEN_WALL
    picture[cells == 0] = FREE
    picture[cells > 0] = OCCUPIED
    return np.ascontiguousarray(picture[::-1])


def plot_trajectories(
    found: Sequence[Results], map_name: str, world: GridMap, settings: EvaluationSettings, path: Path
) -> None:
    """Draw the route of every planner on one map, over what it knew at the end, with beacons and frontiers."""
    figure, axes = panels(len(found), world.size[1] / world.size[0])
    for results, ax in zip(found, axes, strict=False):
        shown = trace(results, map_name, world, settings)
        episode = next(episode for episode in results.episodes if episode.map == map_name)
        route = np.array(episode.waypoints)
        ax.imshow(shown.picture, interpolation="nearest")
        ax.scatter(*shown.frontiers.T, s=1.5, color=palette.FRONTIER.light, linewidths=0, label="frontiers")
        ax.plot(*route.T, color=palette.WAY.light, linewidth=1.0, zorder=2)
        points = ax.scatter(*route.T, c=np.arange(len(route)), cmap="viridis", s=7, zorder=3)
        points.set_label("waypoints, dark to bright")
        ax.scatter(*shown.beacons.T, marker="^", s=26, color=palette.BEACON.light, zorder=4, label="beacons")
        ax.scatter(*route[0], marker="o", s=40, facecolor="none", edgecolor="black", zorder=5, label="start")
        if find_task(results.task).needs_target and world.target is not None:
            target = to_pixels(world, world.target)
            ax.scatter(*target, marker="*", s=70, color=palette.TARGET.light, zorder=5, label="target")
        state = "" if episode.success else ", failed"
        ax.set_title(f"{results.planner}: {episode.distance_m:.0f} m, {episode.steps} steps{state}", fontsize=9)
    for ax in axes:
        ax.set_axis_off()
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=8)
    figure.suptitle(map_name, fontsize=10)
    save(figure, path)


def plot_coverage(
    found: Sequence[Results],
    worlds: Mapping[str, GridMap] | Callable[[str], GridMap],
    settings: EvaluationSettings,
    path: Path,
    progress: Callable[[], None] | None = None,
) -> None:
    """Draw the explored share against the distance: mean over the maps, and the middle half of them.

    Args:
        found: results of all planners.
        worlds: gives the world of a map's name.
        settings: task and mapping.
        path: of the picture.
        progress: called after each episode.
    """
    load = worlds if callable(worlds) else worlds.__getitem__
    farthest = max(episode.distance_m for results in found for episode in results.episodes)
    grid = np.linspace(0.0, max(farthest, 1.0), CURVE_POINTS)
    figure, (ax,) = panels(1, 0.65, 6.0)
    for results in found:
        curves = []
        for episode in results.episodes:
            shown = trace(results, episode.map, load(episode.map), settings)
            # What a scan shows is known from the moment of the scan on.
            curves.append(shown.explored[np.searchsorted(shown.distance, grid, side="right") - 1])
            if progress is not None:
                progress()
        stack = np.array(curves)
        (line,) = ax.plot(grid, stack.mean(axis=0), label=results.planner)
        low, high = np.quantile(stack, (0.25, 0.75), axis=0)
        ax.fill_between(grid, low, high, color=line.get_color(), alpha=0.12, linewidth=0)
    ax.set(xlabel="distance [m]", ylabel="explored share", ylim=(0.0, 1.02))
    ax.legend(fontsize=8)
    ax.grid(alpha=0.3)
    save(figure, path)


def plot_boxes(found: Sequence[Results], path: Path) -> None:
    """Draw the distances of every planner as boxes: quartiles, 5 to 95 %, the mean as a triangle."""
    figure, (ax,) = panels(1, 0.65, 6.0)
    distances = [[episode.distance_m for episode in results.episodes] for results in found]
    ax.boxplot(
        distances,
        tick_labels=[f"{results.planner}\n{_success(results)}" for results in found],
        whis=(5, 95),
        showmeans=True,
        flierprops={"markersize": 2},
    )
    ax.set_ylabel("distance [m]")
    ax.tick_params(axis="x", labelsize=8)
    ax.grid(axis="y", alpha=0.3)
    save(figure, path)


def plot_scatter(found: Sequence[Results], baseline: str, path: Path) -> None:
    """Draw each planner against a baseline, one point per map; below the line is better than the baseline.

    Raises:
        ResultsError: there is no such baseline, or nothing to compare with it.
    """
    reference = find(found, baseline)
    others = [results for results in found if results is not reference]
    if not others:
        raise ResultsError(f"there is only {baseline!r}: a scatter plot needs the results of another planner, too")
    figure, axes = panels(len(others), 1.0)
    theirs = {episode.map: episode for episode in reference.episodes}
    for results, ax in zip(others, axes, strict=False):
        pairs = [(theirs[episode.map], episode) for episode in results.episodes if episode.map in theirs]
        both = np.array([one.success and two.success for one, two in pairs])
        x = np.array([one.distance_m for one, _ in pairs])
        y = np.array([two.distance_m for _, two in pairs])
        top = 1.05 * max(x.max(initial=1.0), y.max(initial=1.0))
        ax.plot([0, top], [0, top], color="gray", linewidth=0.8)
        ax.scatter(x[both], y[both], s=9, alpha=0.7, label="both complete")
        if not both.all():
            ax.scatter(x[~both], y[~both], s=14, marker="x", color=palette.FAULT.light, label="one failed")
        better = f"shorter on {np.mean(y < x - 1e-6):.0%}"
        ax.set(xlim=(0, top), ylim=(0, top), xlabel=f"{baseline} [m]", ylabel=f"{results.planner} [m]")
        ax.set_title(f"ratio {distance_ratio(results, reference):.3f}, {better}", fontsize=9)
        ax.set_aspect("equal")
        ax.legend(fontsize=7)
    save(figure, path)


def _success(results: Results) -> str:
    return f"{np.mean([episode.success for episode in results.episodes]):.0%} complete"


def _in_pixels(world: GridMap, positions: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([to_pixels(world, (x, y)) for x, y in positions.tolist()]).reshape(-1, 2)


def panels(count: int, aspect: float, width: float = PANEL_WIDTH) -> tuple[Any, list[Any]]:
    """Return a figure with `count` axes, at most three in a row.

    Raises:
        ConfigError: matplotlib is not installed.
    """
    with optional("a plot", "plots"):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

    across = min(count, 3)
    down = -(-count // across)
    figure = Figure(figsize=(width * across, (width * aspect + 0.35) * down + 0.3), layout="constrained")
    FigureCanvasAgg(figure)
    axes = [figure.add_subplot(down, across, number + 1) for number in range(count)]
    return figure, axes


def save(figure: Any, path: Path) -> None:
    """Write a figure to a file, its folder made when missing; `ResultsError` when that cannot be."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=110)
    except (OSError, ValueError) as error:
        raise ResultsError(f"cannot write {path} ({error}): choose a folder and .png, .svg or .pdf") from error
