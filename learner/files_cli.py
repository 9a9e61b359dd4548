"""The commands of `hd-learner` that work on files: a run's folder, and certificates."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated, Literal

import typer

from common.cli import command_errors
from common.errors import CheckpointError, ConfigError

RUNS = Path("runs")


class PolicyFormat(Enum):
    """Formats of exported policies, each the suffix of its files."""

    SAFETENSORS = "safetensors"
    ONNX = "onnx"


RunName = Annotated[str | None, typer.Option("--run", help="Name of the run.", metavar="NAME")]
RunsFolder = Annotated[Path, typer.Option("--runs", help="Folder that holds all runs.", metavar="FOLDER")]


def add_file_commands(app: typer.Typer) -> None:
    """Add export, plot, certificates, runs and doctor to the command line."""
    for command in (export, plot, certificates):
        app.command()(command)
    app.command("runs")(list_runs)
    app.command()(doctor)


@command_errors
def export(
    out: Annotated[
        str | None,
        typer.Option("--out", help="File to write, or its URL; NAME.safetensors or NAME.onnx.", metavar="FILE"),
    ] = None,
    run: RunName = None,
    which: Annotated[str, typer.Option("--which", help="best, last, or the name of a checkpoint.")] = "best",
    kind: Annotated[
        PolicyFormat | None, typer.Option("--format", help="File format; that of --out when not given.")
    ] = None,
    runs: RunsFolder = RUNS,
) -> None:
    """Write the policy of a run: safetensors with a JSON card that describes it, or ONNX with the card inside.

    The weights are the moving average of training. Works while the learner runs.

    Examples:
    - `hd-learner export --run office` writes the best evaluated policy to office.safetensors and office.json.

    - `hd-learner export --run office --which last --out policies/office-now.safetensors`

    - `hd-learner export --run office --format onnx` writes office.onnx for ONNX Runtime.

    - `hd-learner export --run office --out s3://bucket/policies/office.safetensors`
    """
    from common.config import RunConfig
    from common.system.remote_files import stored
    from learner.run.export import export_policy

    name = run or RunConfig().name
    place = out or f"{name}.{(kind or PolicyFormat.SAFETENSORS).value}"
    if kind is not None and not place.endswith(f".{kind.value}"):
        raise ConfigError(f"--format {kind.value} needs a file that ends in .{kind.value}, got {place!r}")
    with stored(place) as path:
        card = export_policy(runs / name, which, path)
    figures = "not evaluated"
    if card.evaluation is not None:
        figures = f"{card.evaluation['success']:.0%} complete, {card.evaluation['distance']:.1f} m in evaluation"
    typer.echo(f"{place}: {card.task} policy, version {card.version}, {card.updates} updates, {figures}")


@command_errors
def plot(
    out: Annotated[Path | None, typer.Option("--out", help="Picture to write; NAME.png.", metavar="FILE")] = None,
    run: RunName = None,
    line: Annotated[
        list[str] | None,
        typer.Option("--line", help="Reference line to draw; may be repeated.", metavar="NAME=METRES"),
    ] = None,
    over: Annotated[str, typer.Option("--over", help="minutes or updates; updates exclude pauses.")] = "minutes",
    window: Annotated[int, typer.Option("--window", help="Episodes behind a point of training.", min=1)] = 50,
    by_family: Annotated[bool, typer.Option("--by-family", help="One curve for each family of worlds.")] = False,
    runs: RunsFolder = RUNS,
) -> None:
    """Draw the learning curve of a run: distance and success over time. Works while the learner runs.

    Examples:
    - `hd-learner plot --run office --line greedy=261 --line expert=204 --out curve.png`

    - `hd-learner plot --run office --over updates --window 200`

    - `hd-learner plot --run mix --by-family` draws the families of a mix beside one another.
    """
    from common.config import RunConfig
    from learner.watch.plot import plot_run

    if over not in ("minutes", "updates"):
        raise ConfigError(f"--over: expected minutes or updates, got {over!r}")

    if by_family and line:
        raise ConfigError("--line is a distance in worlds of one kind: leave it out with --by-family")

    name = run or RunConfig().name
    path = out or Path(f"{name}.png")
    curve = plot_run(
        runs / name,
        path,
        dict(map(_yardstick, line or [])),
        over="updates" if over == "updates" else "minutes",
        window=window,
        by_family=by_family,
    )
    newest = f", newest {curve.distance[-1]:.1f} m, {curve.success[-1]:.0%} complete" if len(curve.minutes) else ""
    typer.echo(f"{path}: {len(curve.minutes)} evaluations{newest}")


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
    """Create a certificate authority, and certificates for the learner, each actor host and each robot.

    Examples:
    - `hd-learner certificates pki --host 192.168.1.5 --actor desk --actor rack --robot jackal`

    - `hd-learner start --listen tls/0.0.0.0:7447 --set bus.tls_ca=pki/ca.pem --set bus.tls_certificate=pki/learner.pem
      --set bus.tls_key=pki/learner.key --set bus.tls_access=pki/access.json`
    """
    from learner.certificates import write_pki

    for path in write_pki(folder, host or [], actor or [], robot or []):
        typer.echo(str(path))


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

    summaries, problems = read_summaries(runs)
    if summaries:
        show_runs(summaries, style)
    if problems:
        raise CheckpointError("\n  ".join([f"{len(problems)} runs are left out:", *problems]))


@command_errors
def doctor(
    run: RunName = None,
    repair: Annotated[bool, typer.Option("--repair", help="Set damaged data aside.")] = False,
    runs: RunsFolder = RUNS,
) -> None:
    """Look for damaged and poisoned data in a run that no learner is using: checkpoints, journal, episodes, curves.

    Nothing is deleted: what is removed goes to damaged/ and checkpoints/damaged-... in the run's folder.

    Examples:
    - `hd-learner doctor --run office` reports problems; the exit code is 1 if there are any.

    - `hd-learner doctor --run office --repair`
    """
    from common.config import RunConfig
    from learner.run.doctor import examine

    name = run or RunConfig().name
    findings = examine(runs / name, repair=repair)
    for finding in findings:
        mark = "set right" if finding.mended else "WRONG" if finding.wrong else "ok"
        typer.echo(f"{mark:9} {finding.text}")
    left = sum(finding.wrong and not finding.mended for finding in findings)
    if left:
        advice = "see above" if repair else f"remove them with `hd-learner doctor --run {name} --repair`"
        raise CheckpointError(f"{left} problems in run {name!r}: {advice}")


def _yardstick(text: str) -> tuple[str, float]:
    name, _, metres = text.partition("=")
    try:
        return name, float(metres)
    except ValueError:
        raise ConfigError(f"--line expects NAME=METRES, such as greedy=261, got {text!r}") from None
