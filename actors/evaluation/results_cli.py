"""The commands of `hd-eval` that compare, show and recount results."""

from __future__ import annotations

import re
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from actors.evaluation.options import (
    ConfigFile,
    Limit,
    Maps,
    Overrides,
    PicturesFolder,
    ResultsPaths,
    Start,
    Suffix,
    TableFormat,
    TableStyle,
    Target,
    TextFile,
    write_text,
)
from common.cli import EXIT_ERROR, CommandApp, command_errors, message_console
from common.errors import ConfigError
from common.system.progress import Steps, tell_of_kernels

app = CommandApp()


class UnitsChoice(StrEnum):
    """Units of distances."""

    METRES = "m"
    PIXELS = "px"


class PlotKind(StrEnum):
    """Plots to choose from."""

    ALL = "all"
    TRAJECTORIES = "trajectories"
    COVERAGE = "coverage"
    BOXES = "boxes"
    SCATTER = "scatter"


@app.command()
@command_errors
def table(
    results: ResultsPaths,
    baseline: Annotated[
        str | None,
        typer.Option("--baseline", metavar="PLANNER", help="Compare with it: ratio, interval, paired tests."),
    ] = None,
    style: TableStyle = TableFormat.TEXT,
    units: Annotated[UnitsChoice, typer.Option("--units", help="Metres, or pixels of the maps.")] = UnitsChoice.METRES,
    out: TextFile = None,
) -> None:
    """Compare planners: distance, success, steps, decision time, ratios, paired tests.

    Examples:
    - `hd-eval table results/ --baseline tare`

    - `hd-eval table results/greedy.json results/tare.json --format latex --out table.tex`
    """
    from actors.evaluation.results import collect_results
    from actors.evaluation.table import make_rows, notes, render

    found = collect_results(results)
    titles, rows = make_rows(found, baseline, units.value)
    text = render(titles, rows, style.value, notes(found, baseline))
    write_text(text, out)


@app.command()
@command_errors
def plot(
    results: ResultsPaths,
    out: PicturesFolder,
    kind: Annotated[PlotKind, typer.Option("--kind", help="What to draw.")] = PlotKind.ALL,
    maps: Annotated[
        list[str] | None,
        typer.Option("--maps", metavar="SOURCE", help="Maps of the results; for trajectories and coverage."),
    ] = None,
    map_name: Annotated[
        list[str] | None,
        typer.Option("--map", metavar="NAME", help="Map of the trajectories; may be repeated. [default: the first]"),
    ] = None,
    baseline: Annotated[
        str | None, typer.Option("--baseline", metavar="PLANNER", help="Of the scatter plot. [default: the first]")
    ] = None,
    suffix: Suffix = "png",
    start: Start = None,
    target: Target = None,
    limit: Limit = None,
    config: ConfigFile = None,
    overrides: Overrides = None,
) -> None:
    """Draw trajectories over the belief, coverage against distance, box plots, paired scatter.

    Examples:
    - `hd-eval plot results/ --maps bench/ --out pictures/`

    - `hd-eval plot results/ --kind trajectories --map easy/img_3.png --maps bench/ --out pictures/`

    - `hd-eval plot results/ --kind scatter --baseline tare --out pictures/`
    """
    from actors.evaluation import plots
    from actors.evaluation.resolving import settings_of
    from actors.evaluation.results import ResultsError, collect_results

    found = collect_results(results)
    wanted = [kind] if kind is not PlotKind.ALL else [each for each in PlotKind if each is not PlotKind.ALL]
    console = message_console()
    written: list[Path] = []
    if PlotKind.TRAJECTORIES in wanted or PlotKind.COVERAGE in wanted:
        if not maps:
            raise ConfigError("routes are driven again for this: give --maps, or choose --kind boxes or --kind scatter")
        settings, worlds = settings_of(found[0], maps, limit, config, overrides, start, target)
        names = list(dict.fromkeys(episode.map for each in found for episode in each.episodes))
        numbers = worlds.find(names)
        for name in (map_name or names[:1]) if PlotKind.TRAJECTORIES in wanted else []:
            if name not in numbers:
                raise ResultsError(f"the results have no map {name!r}: choose one such as {names[0]!r}")
            path = out / f"trajectories-{_file_name(name)}.{suffix}"
            plots.plot_trajectories(found, name, worlds.load(numbers[name]), settings, path)
            written.append(path)
        if PlotKind.COVERAGE in wanted:
            path = out / f"coverage.{suffix}"
            with Steps(console) as steps:
                steps.add("coverage", sum(len(each.episodes) for each in found))
                plots.plot_coverage(
                    found, lambda name: worlds.load(numbers[name]), settings, path, lambda: steps.advance("coverage")
                )
            written.append(path)
    if PlotKind.BOXES in wanted:
        plots.plot_boxes(found, out / f"boxes.{suffix}")
        written.append(out / f"boxes.{suffix}")
    if PlotKind.SCATTER in wanted and (len(found) > 1 or kind is PlotKind.SCATTER):
        plots.plot_scatter(found, baseline or found[0].planner, out / f"scatter.{suffix}")
        written.append(out / f"scatter.{suffix}")
    for path in written:
        console.print(str(path), highlight=False)


@app.command()
@command_errors
def video(
    results: Annotated[Path, typer.Argument(metavar="RESULTS", help="Results file of one planner.")],
    maps: Maps,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="The video, ending in .gif or .mp4.")],
    map_name: Annotated[
        str | None, typer.Option("--map", metavar="NAME", help="Map of the episode. [default: the first]")
    ] = None,
    fps: Annotated[int, typer.Option("--fps", min=1, max=60, help="Pictures per second.")] = 10,
    width: Annotated[int, typer.Option("--width", min=64, max=3840, help="Width, pixels.")] = 640,
    start: Start = None,
    target: Target = None,
    limit: Limit = None,
    config: ConfigFile = None,
    overrides: Overrides = None,
) -> None:
    """Make a GIF or MP4 of an episode.

    Examples:
    - `hd-eval video results/greedy.json --maps bench/ --map easy/img_3.png --out episode.gif`

    - `hd-eval video results/greedy.json --maps bench/ --out episode.mp4 --fps 20`
    """
    from actors.evaluation.resolving import settings_of
    from actors.evaluation.results import ResultsError, read_results
    from actors.evaluation.video import write_video

    found = read_results(results)
    episode = next((one for one in found.episodes if map_name in (None, one.map)), None)
    if episode is None:
        raise ResultsError(f"{results} has no episode on map {map_name!r}: choose one of its maps")
    settings, worlds = settings_of(found, maps, limit, config, overrides, start, target)
    world = worlds.load(worlds.find([episode.map])[episode.map])
    count = write_video(found, episode, world, settings, out, fps=fps, width=width)
    message_console().print(f"{out}: {count} pictures of {found.planner} on {episode.map}", highlight=False)


@app.command()
@command_errors
def card(
    policy: Annotated[Path, typer.Argument(metavar="POLICY", help="Weights (.safetensors) with their card.")],
    results: ResultsPaths,
    planner: Annotated[str, typer.Option("--planner", metavar="NAME", help="The policy's name there.")] = "hdplanner",
) -> None:
    """Add a policy's benchmark figures to its card, along with those of the other planners.

    Examples:
    - `hd-eval card exploration.safetensors results/exploration/`
    """
    from actors.evaluation.card import note_bench
    from actors.evaluation.results import collect_results

    bench = note_bench(policy, collect_results(results), planner).bench or {}
    sys.stdout.write(f"{policy}: figures of {', '.join(bench)} noted in its card\n")


@app.command()
@command_errors
def replay(
    results: ResultsPaths,
    maps: Maps,
    start: Start = None,
    target: Target = None,
    limit: Limit = None,
    config: ConfigFile = None,
    overrides: Overrides = None,
) -> None:
    """Recompute results from their waypoints alone, and report discrepancies.

    Routes are driven again in the grid simulator: every figure is recomputed and every rule of the protocol is
    checked. The exit code is 1 when something disagrees.

    Examples:
    - `hd-eval replay results/ --maps bench/`

    - `hd-eval replay results/greedy.json --maps generator:rooms --limit 20`
    """
    from actors.evaluation.recount import recount
    from actors.evaluation.resolving import settings_of
    from actors.evaluation.results import collect_results

    found = collect_results(results)
    settings, worlds = settings_of(found[0], maps, limit, config, overrides, start, target)
    console = message_console()
    tell_of_kernels(console, "common", "actors")
    differing = 0
    for each in found:
        numbers = worlds.find([episode.map for episode in each.episodes])
        disagreements = []
        with Steps(console) as steps:
            for episode in steps.track(each.planner, each.episodes, len(each.episodes)):
                counted = recount(each, episode, worlds.load(numbers[episode.map]), settings)
                if counted.problems:
                    disagreements.append(counted)
        differing += len(disagreements)
        agree = len(each.episodes) - len(disagreements)
        sys.stdout.write(f"{each.planner}: {agree} of {len(each.episodes)} episodes agree\n")
        for counted in disagreements:
            sys.stdout.writelines(f"  {counted.map}: {problem}\n" for problem in counted.problems)
    if differing:
        raise typer.Exit(EXIT_ERROR)


def _file_name(map_name: str) -> str:
    return re.sub(r"[^A-Za-z0-9_]+", "-", map_name.removesuffix(".png")).strip("-")
