"""The command `hd-learner`."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.cli import CommandApp, add_version, command_errors, completing, message_console
from common.errors import ConfigError, StorageError, refusal
from common.extensions import SIMULATORS
from common.page.options import PageOption, PageSettings, TokenOption, page_settings, require_packages
from common.presets import RUN_PRESETS, names_in
from common.system.addresses import listening_address
from common.system.logs import log_file, setup_logging
from common.system.runtime import restart_prepared
from learner.files_cli import RUNS, RunName, RunsFolder, add_file_commands
from learner.page.cli import page as page_command
from learner.remote_cli import add_remote_commands
from learner.router_cli import router

if TYPE_CHECKING:
    from common.config import RunConfig

app = CommandApp(
    name="hd-learner",
    help="The learner: collects experience from actors over the bus, trains the planner, and hands out its policy.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

ConfigFile = Annotated[Path | None, typer.Option("--config", help="TOML or JSON file with settings.", metavar="FILE")]
Preset = Annotated[
    str | None,
    typer.Option(
        "--preset", help=f"Shipped settings to build upon: {', '.join(names_in(RUN_PRESETS))}.", metavar="NAME"
    ),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", help="Change one setting; may be repeated.", metavar="SECTION.FIELD=VALUE"),
]
Listen = Annotated[
    str | None,
    typer.Option("--listen", help="Endpoint to listen on, such as tcp/0.0.0.0:7447 (bus.listen).", metavar="ENDPOINT"),
]
Simulator = Annotated[
    str | None,
    typer.Option(
        "--sim",
        help="Simulator of the actors: pybullet, grid, one from an installed package, or MODULE:CLASS "
        "(simulator.name).",
        metavar="NAME",
        autocompletion=completing(SIMULATORS),
    ),
]
Actors = Annotated[int, typer.Option("--actors", min=0, help="Actors to start on this machine.", metavar="N")]
Evaluators = Annotated[
    int,
    typer.Option(
        "--evaluators", min=0, help="Evaluators to start on this machine; they choose the best policy.", metavar="N"
    ),
]
Learners = Annotated[
    int,
    typer.Option(
        "--learners", min=1, help="Processes that share each update: one for each GPU or few cores.", metavar="N"
    ),
]
Serial = Annotated[bool, typer.Option("--serial", help="Learner and one actor in one process, without a network.")]
MapsElsewhere = Annotated[
    bool, typer.Option("--maps-elsewhere", help="The maps are on the actors' machines: do not check them here.")
]
Metrics = Annotated[
    str | None, typer.Option("--metrics", help="Serve figures for Prometheus there.", metavar="[HOST:]PORT")
]
LogLevel = Annotated[str | None, typer.Option("--log-level", help="debug, info, warning or error.", metavar="LEVEL")]


@app.command()
@command_errors
def start(
    run: RunName = None,
    config: ConfigFile = None,
    preset: Preset = None,
    overrides: Overrides = None,
    listen: Listen = None,
    actors: Actors = 0,
    evaluators: Evaluators = 0,
    learners: Learners = 1,
    metrics: Metrics = None,
    sim: Simulator = None,
    serial: Serial = False,
    maps_elsewhere: MapsElsewhere = False,
    page: PageOption = None,
    page_token: TokenOption = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Delete a run of the same name first.")] = False,
    runs: RunsFolder = RUNS,
    log_level: LogLevel = None,
) -> None:
    """Start a new run, or restart one that has no checkpoint yet.

    Examples:
    - `hd-learner start --actors 2` trains on this machine only.

    - `hd-learner start --run office --preset workstation --set maps.train=generator:office`

    - `hd-learner start --actors 2 --evaluators 1 --page 8080` shows all of it in a browser as well.

    - `hd-learner start --listen tcp/0.0.0.0:7447` waits for `hd-actor --connect tcp/HOST:7447` on other machines.
    """
    restart_prepared()
    from common.config import load_config

    resolved = load_config(config, _all_overrides(overrides, run, listen, sim), os.environ, preset)
    options = RunOptions(
        actors, evaluators, learners, metrics, serial, maps_elsewhere, log_level, _page(page, page_token)
    )
    _run(resolved, runs, options, resume=False, overwrite=overwrite)


@app.command()
@command_errors
def resume(
    run: RunName = None,
    overrides: Overrides = None,
    listen: Listen = None,
    actors: Actors = 0,
    evaluators: Evaluators = 0,
    learners: Learners = 1,
    metrics: Metrics = None,
    sim: Simulator = None,
    serial: Serial = False,
    maps_elsewhere: MapsElsewhere = False,
    source: Annotated[
        str | None,
        typer.Option(
            "--from", help="Fetch the run first: folder of runs at a URL (checkpoints.mirror).", metavar="URL"
        ),
    ] = None,
    page: PageOption = None,
    page_token: TokenOption = None,
    runs: RunsFolder = RUNS,
    log_level: LogLevel = None,
) -> None:
    """Continue a run from its newest valid checkpoint and everything acknowledged since.

    Examples:
    - `hd-learner resume --run office --actors 2`

    - `hd-learner resume --run office --set learner.total_updates=40000` continues beyond its first goal.

    - `hd-learner resume --run office --from s3://bucket/runs` continues here with what another machine left there.
    """
    restart_prepared()
    from common.config import RunConfig, load_config
    from learner.run.folder import check_run, read_config

    name = run or RunConfig().name
    if source is not None:
        from learner.run.mirror import fetch_run

        fetch_run(source, runs, name)
    check_run(runs / name, to_continue=True)
    resolved = load_config(runs / name / "config.json", _all_overrides(overrides, None, listen, sim), os.environ)
    if (held := read_config(runs / name).name) != name:
        raise ConfigError(
            f"the folder {runs / name} holds the run {held!r}, which is its name on the bus, too: rename the folder to "
            f"{held}; a copy cannot become another run, which begins with `hd-learner start --set "
            "learner.initial_policy=FILE`"
        )
    if resolved.name != name:
        raise ConfigError(f"run {name!r} cannot be renamed to {resolved.name!r}: leave HD_NAME and --set name out")
    options = RunOptions(
        actors, evaluators, learners, metrics, serial, maps_elsewhere, log_level, _page(page, page_token)
    )
    _run(resolved, runs, options, resume=True, overwrite=False)


@app.command()
@command_errors
def config(
    config: ConfigFile = None,
    preset: Preset = None,
    overrides: Overrides = None,
    run: RunName = None,
    describe: Annotated[bool, typer.Option("--describe", help="Explain every setting instead (Markdown).")] = False,
) -> None:
    """Print the resolved configuration as TOML, which `--config` reads back.

    Examples:
    - `hd-learner config --preset workstation --set learner.batch_size=32 > run.toml`

    - `hd-learner config --describe | less`
    """
    from common.config import load_config
    from common.config.describe import to_markdown, to_toml

    if describe:
        typer.echo(to_markdown())
    else:
        typer.echo(to_toml(load_config(config, _all_overrides(overrides, run, None, None), os.environ, preset)))


def _all_overrides(overrides: list[str] | None, run: str | None, listen: str | None, sim: str | None) -> list[str]:
    """Put the short options behind the --set ones, since they are the more specific."""
    short = {"name": run, "bus.listen": listen, "simulator.name": sim}
    return [*(overrides or []), *(f"{path}={value}" for path, value in short.items() if value is not None)]


@dataclass(frozen=True, slots=True)
class RunOptions:
    """Options of start and resume that are not part of the configuration; see their help."""

    actors: int
    evaluators: int
    learners: int
    metrics: str | None
    serial: bool
    maps_elsewhere: bool
    log_level: str | None
    page: PageSettings | None


def _run(config: RunConfig, runs: Path, options: RunOptions, *, resume: bool, overwrite: bool) -> None:
    if options.serial and (options.actors or options.evaluators or options.learners > 1):
        raise ConfigError(
            "--serial runs learner and one actor in one process: leave --actors, --evaluators and --learners out"
        )
    if options.serial and options.metrics is not None:
        raise ConfigError("--metrics tells of a run on the bus: leave it out with --serial")
    address = None if options.metrics is None else listening_address(options.metrics, "--metrics")
    if options.serial and options.page:
        raise ConfigError("--serial has no network, which the page reads: leave --page out")
    console = message_console()
    setup_logging(options.log_level, console=console if console.is_terminal else None)
    from learner.map_check import check_maps, has_validation

    if options.evaluators and not has_validation(config):
        raise ConfigError(
            "--evaluators need validation worlds, and the run has none: set maps.validation, or `validation` of a "
            "family that has its own `train`"
        )
    check_maps(config, elsewhere=options.maps_elsewhere)
    # Torch takes seconds, which errors of the configuration need not wait for. Imported before the run's folder is
    # made, so that a missing package leaves none behind.
    from learner.preflight import check_needs
    from learner.run.folder import RunFolder

    listens = {} if address is None else {"--metrics": address}
    if options.page is not None:
        listens["--page"] = options.page.host, options.page.port
    check_needs(config, listens, begins=not resume)
    if options.serial:
        from learner.serial import run_serial
    else:
        from learner.process import Companions, run_learner

    folder = RunFolder.open(runs, config.name) if resume else RunFolder.create(runs, config, overwrite=overwrite)
    with folder, _log_file(folder.path / "learner.log"):
        if resume:
            folder.reconfigure(config)
        if options.serial:
            run_serial(folder, console, resume=resume)
        else:
            companions = Companions(
                options.actors, options.evaluators, options.learners, metrics=address, page=options.page
            )
            run_learner(folder, companions, console, resume=resume)


def _page(address: str | None, token: Path | None) -> PageSettings | None:
    """Return how the page is served; None without one."""
    if address is None:
        return None
    require_packages()  # here: a run that lacks them should not begin
    return page_settings(address, token)


@contextmanager
def _log_file(path: Path) -> Iterator[None]:
    """Write the log into the run's folder as well."""
    try:
        handler = log_file(path)
    except OSError as error:
        raise StorageError(f"cannot write {path}: {refusal(error)}") from error
    logging.getLogger().addHandler(handler)
    try:
        yield
    finally:
        logging.getLogger().removeHandler(handler)
        with suppress(OSError):
            handler.close()


add_version(app)
add_file_commands(app)
add_remote_commands(app)
app.command()(router)
app.command("page")(page_command)
