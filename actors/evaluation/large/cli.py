"""The command `hd-eval large` and those that show its results."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Annotated

import typer

from actors.evaluation.options import (
    ConfigFile,
    CopyTo,
    Jobs,
    Label,
    OutFolder,
    Overrides,
    Overwrite,
    PicturesFolder,
    Planners,
    ResultsPaths,
    Suffix,
    TableFormat,
    TableStyle,
    TaskName,
    TextFile,
    TimeLimit,
    write_text,
)
from actors.evaluation.progress import planner_list, run_and_show
from actors.evaluation.replanning import Replan
from common.cli import EXIT_ERROR, CommandApp, command_errors, message_console
from common.policies.shipped import policy_path
from common.system.logs import setup_logging
from common.system.progress import Steps, tell_of_kernels
from common.tasks import EXPLORATION, find_task

app = CommandApp()

Baseline = Annotated[
    str | None, typer.Option("--baseline", metavar="PLANNER", help="Compare with it: ratio of distances, interval.")
]


@app.command()
@command_errors
def large(
    planner: Planners,
    out: OutFolder,
    task: TaskName = EXPLORATION.name,
    seeds: Annotated[int, typer.Option("--seeds", min=1, help="Number of worlds, from the first on.")] = 5,
    world: Annotated[
        str,
        typer.Option("--world", metavar="SOURCE", help="generator:NAME[?key=value&...], a folder or a file of maps."),
    ] = "generator:building",
    targets: Annotated[int, typer.Option("--targets", min=1, max=50, help="Targets of a tour.")] = 5,
    robot_radius: Annotated[
        float | None,
        typer.Option(
            "--robot-radius",
            min=0.0,
            max=2.0,
            metavar="METRES",
            help="The robot's; planners keep 0.02 m more, and 0 is a point. [default: mapping.robot_radius as it is]",
        ),
    ] = None,
    replan: Annotated[
        Replan,
        typer.Option("--replan", help="Decide at waypoints only, or also where nothing is left to see from the goal."),
    ] = Replan.WAYPOINTS,
    policy: Annotated[
        Path | None, typer.Option("--policy", metavar="FILE", help="Policy (.safetensors) of the planner `hdplanner`.")
    ] = None,
    label: Label = None,
    copy_to: CopyTo = None,
    jobs: Jobs = 0,
    seed: Annotated[
        int, typer.Option("--seed", min=0, max=2**63 - 1, help="Seed of planners, simulator and tours.")
    ] = 0,
    time_limit: TimeLimit = 10.0,
    overwrite: Overwrite = False,
    config: ConfigFile = None,
    overrides: Overrides = None,
) -> None:
    """Explore, or tour, buildings of 130 m x 100 m: a robot under physics, a 16-line lidar, sensing on the way.

    The same command continues an interrupted run. The exit code is 1 when an
    episode crashed; the others are not affected.

    Examples:
    - `hd-eval large --planner greedy,tare,nearest --out exploration/`

    - `hd-eval large --planner dstar_lite,far --task navigation --targets 5 --out navigation/`
    """
    from actors.evaluation.large.robot import LIDAR, MAX_STEPS, TRACKING_ROOM
    from actors.evaluation.runner import Evaluation
    from actors.evaluation.settings import EvaluationSettings
    from actors.evaluation.suited import suited_config
    from actors.evaluation.worlds import WorldSet

    console = message_console()
    setup_logging("warning", console=console if console.is_terminal else None)
    own = [f"simulator.{name}={value}" for name, value in LIDAR.items()]
    own += [f"task.max_steps={MAX_STEPS}", *(overrides or []), f"task.name={task}"]
    if robot_radius is not None:
        own.append(f"mapping.robot_radius={robot_radius + TRACKING_ROOM if robot_radius > 0.0 else 0.0}")
    suited = suited_config([world], config, own, os.environ, map_task=EXPLORATION.name)
    run = suited.run
    settings = EvaluationSettings(
        maps=(world,),
        limit=seeds,
        metres_per_pixel=WorldSet(suited.source, seeds).metres_per_pixel,
        task=run.task,
        mapping=run.mapping,
        simulator=run.simulator,
        seed=seed,
        time_limit=time_limit,
        policy=None if policy is None else str(policy_path(policy).resolve()),
        large=True,
        targets=targets,
        replan=replan,
    )
    names = planner_list(planner)
    with Evaluation(settings, names, out, label=label, overwrite=overwrite) as evaluation:
        crashed = run_and_show(evaluation, names, jobs, console, copy_to)
    if crashed:
        raise typer.Exit(EXIT_ERROR)


@app.command()
@command_errors
def large_table(
    results: ResultsPaths,
    baseline: Baseline = None,
    style: TableStyle = TableFormat.TEXT,
    out: TextFile = None,
) -> None:
    """Compare planners in large worlds: distance, time, computing, volume or targets, collisions.

    Example: `hd-eval large-table exploration/ --baseline tare --format markdown`
    """
    from actors.evaluation.large.results import collect_large_results
    from actors.evaluation.large.table import make_rows, notes
    from actors.evaluation.table import render

    found = collect_large_results(results)
    titles, rows = make_rows(found, baseline)
    write_text(render(titles, rows, style.value, notes(found, baseline)), out)


@app.command()
@command_errors
def large_plot(
    results: ResultsPaths,
    out: PicturesFolder,
    map_name: Annotated[
        list[str] | None,
        typer.Option("--map", metavar="NAME", help="World of the trajectories; may be repeated. [default: the first]"),
    ] = None,
    suffix: Suffix = "png",
) -> None:
    """Draw explored volume against distance and time, and the driven routes.

    Example: `hd-eval large-plot exploration/ --out pictures/`
    """
    from actors.evaluation.large import plots
    from actors.evaluation.large.results import collect_large_results, worlds_of

    found = collect_large_results(results)
    written: list[Path] = []
    if not find_task(found[0].task).needs_target:
        written.append(out / f"volume.{suffix}")
        plots.plot_volume(found, written[-1])
    names = [episode.map for each in found for episode in each.episodes]
    chosen = map_name or names[:1]
    worlds = worlds_of(found[0], chosen)
    for name in chosen:
        written.append(out / f"tracks-{re.sub(r'[^A-Za-z0-9_]+', '-', name).strip('-')}.{suffix}")
        plots.plot_tracks(found, name, worlds[name], written[-1])
    for path in written:
        message_console().print(str(path), highlight=False)


@app.command()
@command_errors
def large_recount(results: ResultsPaths) -> None:
    """Recount results from their tracks, and say where they disagree.

    Every scan is made again where the robot was: distance, time, explored share and volume, arrivals and the places
    themselves are checked. The exit code is 1 when something disagrees.

    Example: `hd-eval large-recount exploration/`
    """
    from actors.evaluation.large.recount import recount
    from actors.evaluation.large.results import collect_large_results, worlds_of

    found = collect_large_results(results)
    console = message_console()
    tell_of_kernels(console, "common", "actors")
    differing = 0
    for each in found:
        worlds = worlds_of(each, [episode.map for episode in each.episodes])
        lines: list[str] = []
        with Steps(console) as steps:
            for episode in steps.track(each.planner, each.episodes, len(each.episodes)):
                problems = recount(each, episode, worlds[episode.map])
                differing += bool(problems)
                lines += [f"  {episode.map}: {problem}\n" for problem in problems]
        agree = len(each.episodes) - len({line.split(":")[0] for line in lines})
        write_text(f"{each.planner}: {agree} of {len(each.episodes)} episodes agree\n" + "".join(lines), None)
    if differing:
        raise typer.Exit(EXIT_ERROR)
