"""Plots of an evaluation at a large scale: explored volume against distance and time, and the driven routes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from actors.evaluation.large.results import LargeEpisode, LargeResults
from actors.evaluation.plots import CURVE_POINTS, panels, save
from actors.evaluation.results import ResultsError
from actors.maps.grid_map import GridMap
from common import palette

# Columns of `LargeEpisode.curve`.
TIME, DISTANCE, VOLUME = 0, 1, 2


def plot_volume(found: Sequence[LargeResults], path: Path) -> None:
    """Draw the explored volume against distance and against time: mean over the worlds, and their range."""
    figure, axes = panels(2, 0.75, 5.5)
    for ax, axis, label in zip(axes, (DISTANCE, TIME), ("distance [m]", "time [s]"), strict=True):
        longest = max(episode.curve[-1][axis] for results in found for episode in results.episodes)
        grid = np.linspace(0.0, max(longest, 1.0), CURVE_POINTS)
        for results in found:
            stack = np.array([_sampled(episode, axis, grid) for episode in results.episodes])
            (line,) = ax.plot(grid, stack.mean(axis=0), label=f"{results.planner} ({len(stack)})")
            ax.fill_between(grid, stack.min(axis=0), stack.max(axis=0), color=line.get_color(), alpha=0.12, linewidth=0)
        ax.set(xlabel=label, ylabel="explored volume [m³]", ylim=(0.0, None))
        ax.grid(alpha=0.3)
    axes[0].legend(fontsize=8, title="planner (worlds)", title_fontsize=8)
    save(figure, path)


def plot_tracks(found: Sequence[LargeResults], map_name: str, world: GridMap, path: Path) -> None:
    """Draw the way of every planner through one world, dark to bright with time; targets are numbered.

    Raises:
        ResultsError: nobody has an episode in that world.
    """
    shown = [(results, episode) for results in found for episode in results.episodes if episode.map == map_name]
    if not shown:
        raise ResultsError(f"the results have no world {map_name!r}: choose one of theirs")
    figure, axes = panels(len(shown), world.size[1] / world.size[0], 6.0)
    (x, y), (width, height) = world.origin, world.size
    picture = np.where(world.free, 0.96, 0.25)
    for (results, episode), ax in zip(shown, axes, strict=False):
        ax.imshow(picture, cmap="gray", vmin=0.0, vmax=1.0, origin="lower", extent=(x, x + width, y, y + height))
        track = np.array(episode.track)
        ax.scatter(track[:, 1], track[:, 2], c=track[:, 0], cmap="viridis", s=1.2, linewidths=0)
        ax.scatter(*track[0, 1:3], marker="o", s=40, facecolor="none", edgecolor="black", label="start")
        for number, leg in enumerate(episode.legs, 1):
            colour = (palette.GOOD if leg.success else palette.FAULT).light
            ax.scatter(*leg.target, marker="*", s=60, color=colour, zorder=4)
            ax.annotate(str(number), leg.target, fontsize=8, color=colour, xytext=(3, 3), textcoords="offset points")
        state = "" if episode.success else ", failed"
        ax.set_title(f"{results.planner}: {episode.distance_m:.0f} m, {episode.time_s:.0f} s{state}", fontsize=9)
        ax.set_axis_off()
    figure.suptitle(map_name, fontsize=10)
    save(figure, path)


def _sampled(episode: LargeEpisode, axis: int, grid: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the volume over a grid of distances or times; it stays as it was at the end."""
    curve = np.array(episode.curve)
    return np.interp(grid, curve[:, axis], curve[:, VOLUME])
