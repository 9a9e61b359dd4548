"""The commands of `hd-learner` that reach a running learner over the bus."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from common.cli import command_errors, output_console
from common.system.steady_time import LONGEST_WAIT

if TYPE_CHECKING:
    import zenoh

    from learner.watch.status import LearnerStatus

RunName = Annotated[
    str | None, typer.Option("--run", help="Name of the run; may be left out when only one is live.", metavar="NAME")
]
Connect = Annotated[
    str | None,
    typer.Option("--connect", help="Endpoint of the learner (default: bus.listen).", metavar="ENDPOINT"),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", help="Settings of the bus, such as bus.tls_ca=pki/ca.pem.", metavar="BUS.FIELD=VALUE"),
]
Timeout = Annotated[
    float, typer.Option("--timeout", min=0.1, max=LONGEST_WAIT, help="Seconds to wait for the learner.")
]

CHECKPOINT_TIMEOUT = 65.0


def add_remote_commands(app: typer.Typer) -> None:
    """Add status, stop, checkpoint, pause and unpause to the command line."""
    for command in (status, stop, checkpoint, pause, unpause):
        app.command()(command)


@command_errors
def status(
    run: RunName = None,
    connect: Connect = None,
    overrides: Overrides = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
    timeout: Timeout = 3.0,
) -> None:
    """Show what a running learner and its actors do.

    Examples:
    - `hd-learner status`

    - `hd-learner status --run office --connect tcp/192.168.1.5:7447 --json | jq .steps_per_second`
    """
    from learner.watch.view import render

    found = _ask("status", run, connect, overrides, timeout)
    if as_json:
        typer.echo(json.dumps(found.to_json(), indent=2))
    else:
        output_console().print(render(found))


@command_errors
def stop(run: RunName = None, connect: Connect = None, overrides: Overrides = None, timeout: Timeout = 5.0) -> None:
    """Stop a running learner: it writes a checkpoint and ends, its local actors with it.

    Example: `hd-learner stop --run office`
    """
    found = _ask("stop", run, connect, overrides, timeout)
    typer.echo(
        f"run {found.run} stops after {found.updates} updates; continue with `hd-learner resume --run {found.run}`"
    )


@command_errors
def checkpoint(
    run: RunName = None,
    connect: Connect = None,
    overrides: Overrides = None,
    timeout: Timeout = CHECKPOINT_TIMEOUT,
) -> None:
    """Make a running learner write a checkpoint now.

    Example: `hd-learner checkpoint --run office`
    """
    found = _ask("checkpoint", run, connect, overrides, timeout)
    typer.echo(f"run {found.run}: checkpoint {found.last_checkpoint} written")


@command_errors
def pause(run: RunName = None, connect: Connect = None, overrides: Overrides = None, timeout: Timeout = 5.0) -> None:
    """Pause a running learner and its actors.

    Example: `hd-learner pause --run office`
    """
    found = _ask("pause", run, connect, overrides, timeout)
    typer.echo(f"run {found.run} is paused at {found.updates} updates; `hd-learner unpause` continues it")


@command_errors
def unpause(run: RunName = None, connect: Connect = None, overrides: Overrides = None, timeout: Timeout = 5.0) -> None:
    """Continue a paused learner.

    Example: `hd-learner unpause --run office`
    """
    found = _ask("resume", run, connect, overrides, timeout)
    typer.echo(f"run {found.run} continues from {found.updates} updates")


def _ask(verb: str, run: str | None, connect: str | None, overrides: list[str] | None, timeout: float) -> LearnerStatus:
    """Send one command and return the learner's status after it."""
    from learner.watch.asking import ask_learner, only_run

    with _session(connect, overrides) as session:
        return ask_learner(session, run or only_run(session, timeout), verb, timeout)


@contextmanager
def _session(connect: str | None, overrides: list[str] | None) -> Iterator[zenoh.Session]:
    from common.bus.session import open_client_session
    from common.config import load_config

    bus = load_config(None, overrides or (), os.environ).bus
    with open_client_session(bus, [connect] if connect else None) as session:
        yield session
