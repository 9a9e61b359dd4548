"""The command `hd-eval`: which planner is better, by how much, and whether the difference is significant."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from actors.cli_options import Fidelity
from actors.evaluation.large.cli import app as large_app
from actors.evaluation.options import (
    ConfigFile,
    CopyTo,
    Jobs,
    Label,
    Limit,
    Maps,
    OutFolder,
    Overrides,
    Overwrite,
    Planners,
    Start,
    Target,
    TaskName,
    TimeLimit,
)
from actors.evaluation.progress import planner_list, run_and_show
from actors.evaluation.results_cli import app as results_app
from common.cli import (
    EXIT_ERROR,
    CommandApp,
    add_version,
    command_errors,
    completing,
    message_console,
    output_console,
    whole_table,
)
from common.extensions import SIMULATORS
from common.system.logs import setup_logging
from common.system.progress import Steps
from common.tasks import EXPLORATION

app = CommandApp(
    name="hd-eval",
    help="Evaluation: run planners on maps, compare them, plot and verify the results.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.command()
@command_errors
def run(
    planner: Planners,
    maps: Maps,
    out: OutFolder,
    task: TaskName = EXPLORATION.name,
    sim: Annotated[
        str,
        typer.Option(
            "--sim",
            metavar="NAME",
            help="Simulator: grid, pybullet, one that a package adds, or MODULE:CLASS.",
            autocompletion=completing(SIMULATORS),
        ),
    ] = "grid",
    fidelity: Annotated[Fidelity | None, typer.Option("--fidelity", help="Fidelity of PyBullet.")] = None,
    policy: Annotated[
        Path | None, typer.Option("--policy", metavar="FILE", help="Policy of `hdplanner`; else the shipped one.")
    ] = None,
    start: Start = None,
    target: Target = None,
    limit: Limit = None,
    label: Label = None,
    copy_to: CopyTo = None,
    jobs: Jobs = 0,
    seed: Annotated[int, typer.Option("--seed", min=0, max=2**63 - 1, help="Seed of planners and simulator.")] = 0,
    time_limit: TimeLimit = 10.0,
    overwrite: Overwrite = False,
    config: ConfigFile = None,
    overrides: Overrides = None,
) -> None:
    """Run planners on maps, and write one results file per planner.

    The same command continues an interrupted run. The exit code is 1 when an
    episode crashed; the others are not affected.

    Examples:
    - `hd-eval run --planner greedy,tare,omniscient --maps bench/ --out results/`

    - `hd-eval run --planner hdplanner,hdplanner-bare --policy best.safetensors --maps bench/ --out results/`

    - `hd-eval run --planner hdplanner --policy ariadne.safetensors --label ariadne --maps bench/ --out results/`

    - `hd-eval run --planner greedy --maps plan.yaml --start 1.5 2.0 --out results/`

    - `hd-eval run --planner nearest,tare --maps floorplans:plans/ --out results/`

    - `hd-eval run --planner dstar_lite,far --task navigation --maps bench/ --sim pybullet --jobs 4 --out results/`
    """
    from actors.evaluation.worker_process import WorkerProcesses

    console = message_console()
    setup_logging("warning", console=console if console.is_terminal else None)
    with WorkerProcesses() as processes:
        # It imports while this process does.
        processes.prepare()
        from actors.evaluation.resolving import resolve
        from actors.evaluation.runner import Evaluation

        settings = resolve(
            maps,
            limit,
            config,
            overrides,
            start=start,
            target=target,
            task=task,
            simulator=sim,
            fidelity=None if fidelity is None else fidelity.value,
            seed=seed,
            time_limit=time_limit,
            policy=policy,
            tell=lambda line: console.print(line, markup=False, emoji=False, highlight=False, soft_wrap=True),
        )
        names = planner_list(planner)
        with Evaluation(settings, names, out, label=label, overwrite=overwrite, processes=processes) as evaluation:
            crashed = run_and_show(evaluation, names, jobs, console, copy_to, warn_of_limit=True)
    if crashed:
        raise typer.Exit(EXIT_ERROR)


@app.command()
@command_errors
def planners() -> None:
    """List the planners by name.

    Example: `hd-eval planners`
    """
    from actors.evaluation.settings import names_with_summaries

    for name, summary in names_with_summaries().items():
        sys.stdout.write(f"{name:18} {summary}\n")


add_version(app)


@app.command("maps")
@command_errors
def public_maps(
    name: Annotated[str | None, typer.Argument(metavar="SET", help="Name of a public set.")] = None,
    folder: Annotated[Path | None, typer.Argument(metavar="FOLDER", help="Folder that should hold it.")] = None,
) -> None:
    """List the public sets of maps and how to fetch them, or check a folder that should hold one.

    With SET alone: the commands that fetch it, how to prepare it, and the settings recommended for it. The exit code
    is 1 if the folder has problems.

    Examples:
    - `hd-eval maps`

    - `hd-eval maps floorplans`

    - `hd-eval maps exploration-easy ARiADNE/DungeonMaps/easy`
    """
    from actors.maps.public_sets import PUBLIC_SETS, check_folder, find_set

    if name is None:
        table = whole_table("set", "maps", "use", "licence", "--maps", "fetch it", box=None, pad_edge=False)
        for each in PUBLIC_SETS.values():
            count = "" if each.count is None else str(each.count)
            table.add_row(each.name, count, each.use, each.licence, each.source, each.commands)
        output_console().print(table)
        return
    wanted = find_set(name)
    if folder is None:
        sys.stdout.write(f"{wanted.commands}\n")
        if wanted.preparation:
            sys.stdout.write(f"prepare: {wanted.preparation}\n")
        settings = ", ".join(f"{path}={value}" for path, value in wanted.recommendation.settings.items())
        sys.stdout.write(f"use: --maps {wanted.source}{f' ({settings})' if settings else ''}\n")
        return
    with Steps(message_console(), "maps") as steps:
        found = check_folder(wanted, folder, lambda files, total: steps.track(name, files, total))
    for problem in found.problems:
        sys.stdout.write(f"{problem}\n")
    sys.stdout.write(f"{folder}: {found.maps} maps, {len(found.problems)} problems\n")
    if found.problems:
        raise typer.Exit(EXIT_ERROR)


app.add_typer(results_app)
app.add_typer(large_app)

if __name__ == "__main__":
    app()
