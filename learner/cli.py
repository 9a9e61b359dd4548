"""The command `hd-learner`."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated, Literal

import typer

from common.cli import CommandApp, add_version, command_errors, completing, message_console
from common.config import RunConfig
from common.config.describe import to_markdown, to_toml
from common.config.load import load_config, preset_names
from common.errors import CheckpointError, ConfigError, StorageError
from common.extensions import SIMULATORS
from common.page.options import PageOption, PageSettings, TokenOption, page_settings
from common.system.extras import optional
from common.system.logs import log_file, setup_logging
from common.system.runtime import restart_prepared
from learner.map_check import check_maps
from learner.page.cli import page as page_command
from learner.remote_cli import add_remote_commands

app = CommandApp(
    name="hd-learner",
    help="The learner: collects experience from actors over the bus, trains the planner, and hands out its policy.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

RUNS = Path("runs")


class PolicyFormat(Enum):
    """Formats of exported policies, each the suffix of its files."""

    SAFETENSORS = "safetensors"
    ONNX = "onnx"


RunName = Annotated[str | None, typer.Option("--run", help="Name of the run.", metavar="NAME")]
RunsFolder = Annotated[Path, typer.Option("--runs", help="Folder that holds all runs.", metavar="FOLDER")]
ConfigFile = Annotated[Path | None, typer.Option("--config", help="TOML or JSON file with settings.", metavar="FILE")]
Preset = Annotated[
    str | None,
    typer.Option("--preset", help=f"Shipped settings to build upon: {', '.join(preset_names())}.", metavar="NAME"),
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
        help="Simulator of actors: pybullet, grid, one that a package adds, or MODULE:CLASS (simulator.name).",
        metavar="NAME",
        autocompletion=completing(SIMULATORS),
    ),
]
Actors = Annotated[int, typer.Option("--actors", min=0, help="Actors to start on this machine.", metavar="N")]
Evaluators = Annotated[
    int,
    typer.Option("--evaluators", min=0, help="Evaluating actors to start here; they choose the best.", metavar="N"),
]
Serial = Annotated[bool, typer.Option("--serial", help="Learner and one actor in one process, without a network.")]
MapsElsewhere = Annotated[
    bool, typer.Option("--maps-elsewhere", help="Maps lie on the actors' machines: do not look for them here.")
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
    sim: Simulator = None,
    serial: Serial = False,
    maps_elsewhere: MapsElsewhere = False,
    page: PageOption = None,
    page_token: TokenOption = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Delete a run of the same name first.")] = False,
    runs: RunsFolder = RUNS,
    log_level: LogLevel = None,
) -> None:
    """Start a new run, or one again whose first start came to no checkpoint.

    Examples:
    - `hd-learner start --actors 2` trains on this machine alone.

    - `hd-learner start --run office --preset workstation --set maps.train=generator:office`

    - `hd-learner start --actors 2 --evaluators 1 --page 8080` shows all of it in a browser as well.

    - `hd-learner start --listen tcp/0.0.0.0:7447` waits for `hd-actor --connect tcp/HOST:7447` on other machines.
    """
    restart_prepared()
    resolved = load_config(config, _all_overrides(overrides, run, listen, sim), os.environ, preset)
    options = RunOptions(actors, evaluators, serial, maps_elsewhere, log_level, _page(page, page_token))
    _run(resolved, runs, options, resume=False, overwrite=overwrite)


@app.command()
@command_errors
def resume(
    run: RunName = None,
    overrides: Overrides = None,
    listen: Listen = None,
    actors: Actors = 0,
    evaluators: Evaluators = 0,
    sim: Simulator = None,
    serial: Serial = False,
    maps_elsewhere: MapsElsewhere = False,
    page: PageOption = None,
    page_token: TokenOption = None,
    runs: RunsFolder = RUNS,
    log_level: LogLevel = None,
) -> None:
    """Continue a run from its newest sound checkpoint and everything that was acknowledged since.

    Examples:
    - `hd-learner resume --run office --actors 2`

    - `hd-learner resume --run office --set learner.total_updates=40000` goes on beyond its first goal.
    """
    from learner.run.folder import check_run

    restart_prepared()
    name = run or RunConfig().name
    check_run(runs / name, to_continue=True)
    resolved = load_config(runs / name / "config.json", _all_overrides(overrides, None, listen, sim), os.environ)
    if resolved.name != name:
        raise ConfigError(f"run {name!r} cannot be renamed to {resolved.name!r}: leave HD_NAME and --set name out")
    options = RunOptions(actors, evaluators, serial, maps_elsewhere, log_level, _page(page, page_token))
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
    if describe:
        typer.echo(to_markdown())
    else:
        typer.echo(to_toml(load_config(config, _all_overrides(overrides, run, None, None), os.environ, preset)))


@app.command()
@command_errors
def export(
    out: Annotated[
        Path | None, typer.Option("--out", help="File to write; NAME.safetensors or NAME.onnx.", metavar="FILE")
    ] = None,
    run: RunName = None,
    which: Annotated[str, typer.Option("--which", help="best, last, or the name of a checkpoint.")] = "best",
    kind: Annotated[
        PolicyFormat | None, typer.Option("--format", help="File format; that of --out when not given.")
    ] = None,
    runs: RunsFolder = RUNS,
) -> None:
    """Write the policy of a run: safetensors beside a JSON card that says what it is, or ONNX with the card inside.

    The weights are the moving average of training. Works while the learner runs.

    Examples:
    - `hd-learner export --run office` writes the best evaluated policy to office.safetensors and office.json.

    - `hd-learner export --run office --which last --out policies/office-now.safetensors`

    - `hd-learner export --run office --format onnx` writes office.onnx for ONNX Runtime.
    """
    from learner.run.export import export_policy

    name = run or RunConfig().name
    path = out or Path(f"{name}.{(kind or PolicyFormat.SAFETENSORS).value}")
    if kind is not None and path.suffix != f".{kind.value}":
        raise ConfigError(f"--format {kind.value} needs a file that ends in .{kind.value}, got {path.name!r}")
    card = export_policy(runs / name, which, path)
    figures = "not evaluated"
    if card.evaluation is not None:
        figures = f"{card.evaluation['success']:.0%} complete, {card.evaluation['distance']:.1f} m in evaluation"
    typer.echo(f"{path}: {card.task} policy, version {card.version}, {card.updates} updates, {figures}")


@app.command()
@command_errors
def plot(
    out: Annotated[Path | None, typer.Option("--out", help="Picture to write; NAME.png.", metavar="FILE")] = None,
    run: RunName = None,
    line: Annotated[
        list[str] | None,
        typer.Option("--line", help="Yardstick to draw across; may be repeated.", metavar="NAME=METRES"),
    ] = None,
    over: Annotated[str, typer.Option("--over", help="minutes, or updates: these leave out pauses.")] = "minutes",
    window: Annotated[int, typer.Option("--window", help="Episodes behind a point of training.", min=1)] = 50,
    runs: RunsFolder = RUNS,
) -> None:
    """Draw the learning curve of a run: distance and success over time. Works while the learner runs.

    Examples:
    - `hd-learner plot --run office --line greedy=261 --line expert=204 --out curve.png`

    - `hd-learner plot --run office --over updates --window 200`
    """
    from learner.watch.plot import plot_run

    if over not in ("minutes", "updates"):
        raise ConfigError(f"--over: expected minutes or updates, got {over!r}")

    name = run or RunConfig().name
    path = out or Path(f"{name}.png")
    curve = plot_run(
        runs / name,
        path,
        dict(map(_yardstick, line or [])),
        over="updates" if over == "updates" else "minutes",
        window=window,
    )
    newest = f", newest {curve.distance[-1]:.1f} m, {curve.success[-1]:.0%} complete" if len(curve.minutes) else ""
    typer.echo(f"{path}: {len(curve.minutes)} evaluations{newest}")


@app.command()
@command_errors
def certificates(
    folder: Annotated[Path, typer.Argument(help="Where the files go.", metavar="FOLDER")] = Path("pki"),
    host: Annotated[
        list[str] | None, typer.Option("--host", help="Name or address of the learner's machine; may be repeated.")
    ] = None,
    actor: Annotated[
        list[str] | None, typer.Option("--actor", help="Host of actors, as in their names; may be repeated.")
    ] = None,
    robot: Annotated[list[str] | None, typer.Option("--robot", help="Name of a robot; may be repeated.")] = None,
) -> None:
    """Make an own authority and one certificate for the learner, each actor host and each robot.

    Examples:
    - `hd-learner certificates pki --host 192.168.1.5 --actor desk --actor rack --robot jackal`

    - `hd-learner start --listen tls/0.0.0.0:7447 --set bus.tls_ca=pki/ca.pem --set bus.tls_certificate=pki/learner.pem
      --set bus.tls_key=pki/learner.key --set bus.tls_access=pki/access.json`
    """
    from learner.certificates import write_pki

    for path in write_pki(folder, host or [], actor or [], robot or []):
        typer.echo(str(path))


@app.command("runs")
@command_errors
def list_runs(
    runs: RunsFolder = RUNS,
    style: Annotated[Literal["text", "csv", "json"], typer.Option("--format", help="Of the table.")] = "text",
) -> None:
    """Compare runs: one line each, from the summaries that their checkpoints write.

    Examples:
    - `hd-learner runs`

    - `hd-learner runs --format csv > runs.csv`
    """
    from learner.run.summary import read_summaries
    from learner.watch.runs_table import show_runs

    show_runs(read_summaries(runs), style)


@app.command()
@command_errors
def doctor(
    run: RunName = None,
    repair: Annotated[bool, typer.Option("--repair", help="Set aside what cannot be used.")] = False,
    runs: RunsFolder = RUNS,
) -> None:
    """Look for damage and poison in a run that no learner works on: checkpoints, journal, episodes, curves.

    Nothing is thrown away: what is taken out lies in the run's folder under damaged/ and checkpoints/damaged-...

    Examples:
    - `hd-learner doctor --run office` says what is wrong, and ends with exit code 1 when something is.

    - `hd-learner doctor --run office --repair`
    """
    from learner.run.doctor import examine

    name = run or RunConfig().name
    findings = examine(runs / name, repair=repair)
    for finding in findings:
        mark = "set right" if finding.mended else "WRONG" if finding.wrong else "ok"
        typer.echo(f"{mark:9} {finding.text}")
    left = sum(finding.wrong and not finding.mended for finding in findings)
    if left:
        advice = "see above" if repair else f"take them out with `hd-learner doctor --run {name} --repair`"
        raise CheckpointError(f"{left} things are wrong in run {name!r}: {advice}")


def _yardstick(text: str) -> tuple[str, float]:
    name, _, metres = text.partition("=")
    try:
        return name, float(metres)
    except ValueError:
        raise ConfigError(f"--line expects NAME=METRES, such as greedy=261, got {text!r}") from None


def _all_overrides(overrides: list[str] | None, run: str | None, listen: str | None, sim: str | None) -> list[str]:
    """Put the short options behind the --set ones, since they are the more specific."""
    short = {"name": run, "bus.listen": listen, "simulator.name": sim}
    return [*(overrides or []), *(f"{path}={value}" for path, value in short.items() if value is not None)]


@dataclass(frozen=True, slots=True)
class RunOptions:
    """What start and resume are told beside the configuration; see their help."""

    actors: int
    evaluators: int
    serial: bool
    maps_elsewhere: bool
    log_level: str | None
    page: PageSettings | None


def _run(config: RunConfig, runs: Path, options: RunOptions, *, resume: bool, overwrite: bool) -> None:
    if options.serial and (options.actors or options.evaluators):
        raise ConfigError("--serial runs one actor in the learner's own process: leave --actors and --evaluators out")
    if options.serial and options.page:
        raise ConfigError("--serial has no network, which the page reads: leave --page out")
    console = message_console()
    setup_logging(options.log_level, console=console if console.is_terminal else None)
    check_maps(config, elsewhere=options.maps_elsewhere)
    # Imported here, so that help and errors of the configuration come at once: torch takes seconds. Imported before the
    # run's folder is made, so that a missing package leaves none behind.
    from learner.run.folder import RunFolder
    from learner.watch.writers import check_writers

    check_writers(config)
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
            companions = Companions(options.actors, options.evaluators, page=options.page)
            run_learner(folder, companions, console, resume=resume)


def _page(address: str | None, token: Path | None) -> PageSettings | None:
    """Return how the page is served; None without one."""
    if address is None:
        return None
    with optional("--page", "page"):
        import starlette  # noqa: F401 - asked for here: a run that lacks it should not begin
        import uvicorn  # noqa: F401
        import websockets  # noqa: F401
    return page_settings(address, token)


@contextmanager
def _log_file(path: Path) -> Iterator[None]:
    """Write the log into the run's folder as well."""
    try:
        handler = log_file(path)
    except OSError as error:
        raise StorageError(f"cannot write {path}: {error.strerror}; make room on the disk") from error
    logging.getLogger().addHandler(handler)
    try:
        yield
    finally:
        logging.getLogger().removeHandler(handler)
        with suppress(OSError):
            handler.close()


add_version(app)
add_remote_commands(app)
app.command("page")(page_command)


def main() -> None:
    """Run the command; the entry point `hd-learner`."""
    app()


if __name__ == "__main__":
    main()
