"""`hd-deploy record`, `hd-deploy replay` and `hd-deploy recover`."""

from __future__ import annotations

import json
import tempfile
import threading
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from common.cli import CommandApp, command_errors, message_console, output_console
from common.registry import refuse_modules
from common.system.logs import setup_logging
from common.system.progress import Steps, tell_of_kernels
from common.system.signals import stopping_signals
from deploy.cli_options import ConfigFile, Connect, LogLevel, Overrides, Profile, load_options

if TYPE_CHECKING:
    from deploy.config import DeployConfig

app = CommandApp()

Rerun = Annotated[bool, typer.Option("--rerun", help="Show it live in Rerun (extra `rerun`).")]

RECORD_EXAMPLES = """
Examples:

  hd-deploy record                                   every topic, into recordings/<date and time>

  hd-deploy record /scan /odom '/hd/*' --out lab     some topics; patterns in quotes

  hd-deploy record --exclude '*image*' --connect tcp/192.168.1.5:7447
"""
REPLAY_EXAMPLES = """
Examples:

  hd-deploy replay lab                               repeat the decisions with the recorded parameters, and compare

  hd-deploy replay lab --planner tare                what would another planner have done?

  hd-deploy replay my_bag --profile nav2             check the integration of a robot by its own `ros2 bag`

  hd-deploy replay lab --min-agreement 0.9           exit code 1 when fewer waypoints agree
"""


@app.command(epilog=RECORD_EXAMPLES)
@command_errors
def record(
    topics: Annotated[
        list[str] | None, typer.Argument(help="Topics, or patterns such as '/hd/*'. [default: all]", metavar="TOPIC...")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder of the new bag.", metavar="FOLDER")] = None,
    exclude: Annotated[
        list[str] | None, typer.Option("--exclude", help="Pattern to leave out.", metavar="PATTERN")
    ] = None,
    duration: Annotated[
        float | None, typer.Option("--duration", min=0.1, help="Seconds. [default: until Ctrl-C]")
    ] = None,
    compression: Annotated[
        Literal["none", "lz4", "zstd"], typer.Option("--compression", help="Of the file's chunks.")
    ] = "zstd",
    connect: Connect = None,
    profile: Profile = None,
    config: ConfigFile = None,
    overrides: Overrides = None,
    rerun: Rerun = False,
    log_level: LogLevel = None,
) -> None:
    """Record a robot's topics into a bag that ROS 2 and Foxglove open; it can be read whenever the recorder ends."""
    setup_logging(log_level)
    from deploy.recording.bag_recorder import BagRecorder
    from deploy.recording.viewer import Viewer
    from deploy.recording.writer import BagWriter

    resolved = load_options(profile, config, overrides, connect)
    folder = out or Path("recordings") / datetime.now().astimezone().strftime("%Y-%m-%d-%H-%M-%S")
    listener = Viewer(resolved.ros.distro).show if rerun else None
    stop = threading.Event()
    with (
        stopping_signals(stop.set, stop.is_set),
        BagWriter(folder, resolved.ros.distro, compression, resolved) as bag,
        BagRecorder(resolved.ros, bag, topics or (), exclude or (), listener) as recorder,
    ):
        recorder.run(stop, duration or float("inf"))
    typer.echo(f"{bag.count} messages on {len(bag.topics)} topics, {bag.size / 1e6:.1f} MB: {folder}")


@app.command(epilog=REPLAY_EXAMPLES)
@command_errors
def replay(
    path: Annotated[Path, typer.Argument(help="Folder of a bag, or an .mcap file.", metavar="FILE")],
    profile: Profile = None,
    config: ConfigFile = None,
    overrides: Overrides = None,
    planner: Annotated[str | None, typer.Option("--planner", help="Decide with this planner instead.")] = None,
    tolerance: Annotated[
        float | None,
        typer.Option("--tolerance", min=0.0, help="Waypoints so near agree, m. [default: half the viewpoint spacing]"),
    ] = None,
    checks_only: Annotated[bool, typer.Option("--checks-only", help="Check the topics and decide nothing.")] = False,
    min_agreement: Annotated[
        float, typer.Option("--min-agreement", min=0.0, max=1.0, help="Exit code 1 below this share.")
    ] = 0.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    rerun: Rerun = False,
    log_level: LogLevel = None,
) -> None:
    """Repeat the decisions of a recording and compare them; check rates, gaps, frames and stamps.

    Parameters are those of the recording, unless --profile or --config gives others; --set changes single ones.
    """
    setup_logging(log_level or "warning")
    from deploy.profiles import named_parts
    from deploy.recording.bag_player import BagPlayer, has_decisions
    from deploy.recording.checks import Checks
    from deploy.recording.comparison import compare
    from deploy.recording.order import FileOrder
    from deploy.recording.reader import read_bag, recorded_config
    from deploy.recording.report import show, summary
    from deploy.recording.viewer import Viewer

    every = [*(overrides or ()), *([f"decision.planner={planner}"] if planner else ())]
    resolved = None if profile or config else recorded_config(path)
    if resolved is None:
        resolved = load_options(profile, config, every)
    else:
        resolved = _override(resolved, every)
        given = {text.partition("=")[2] for text in every}
        refuse_modules(named_parts(resolved), given, f"the recording {path}", "give --planner, or --set to change it")
    viewer = Viewer(resolved.ros.distro) if rerun else None
    checks = Checks(resolved)
    order = FileOrder()
    for recorded in order.learning(read_bag(path)):
        checks.add(recorded)
        if viewer is not None:
            viewer.show(recorded.topic, recorded.kind, recorded.payload, recorded.time)
    replayed = comparison = None
    if not checks_only:
        console = message_console()
        tell_of_kernels(console, "common", "deploy")
        again = BagPlayer(resolved, not has_decisions(checks.topics, resolved.topics, resolved.ros.namespace))
        with Steps(console, "messages") as steps:
            total = sum(topic.count for topic in checks.topics.values())
            replayed = again.run(steps.track("replay", order.read(path, again.topics), total))
        limit = resolved.mapping.viewpoint_spacing / 2.0 if tolerance is None else tolerance
        comparison = compare(replayed.recorded, replayed.decided, replayed.begin, limit)
    result = summary(checks, replayed, comparison)
    if as_json:
        typer.echo(json.dumps(result, indent=2))
    else:
        show(result, output_console())
    if comparison is not None and comparison.agreement < min_agreement:
        raise typer.Exit(1)


@app.command()
@command_errors
def recover(
    path: Annotated[Path, typer.Argument(help="Folder of a bag, or an .mcap file.", metavar="FILE")],
    out: Annotated[Path, typer.Argument(help="Folder of the new bag.", metavar="FOLDER")],
    log_level: LogLevel = None,
) -> None:
    """Complete the bag of a recorder that was killed, for tools that need its index.

    Example: `hd-deploy recover recordings/2026-03-01-10-20-30 whole`
    """
    setup_logging(log_level)
    from deploy.recording.reader import recover as recover_bag

    typer.echo(f"{recover_bag(path, out)} messages: {out}")


def _override(recorded: DeployConfig, overrides: Sequence[str]) -> DeployConfig:
    """Change single parameters of a recording's own."""
    from deploy.profiles import load_deploy_config

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "recorded.json"
        file.write_text(recorded.model_dump_json(), "utf-8")
        return load_deploy_config(file, overrides)
