"""The command `hd-actor`: simulated robots that collect experience for a learner."""

from __future__ import annotations

import logging
import os
from contextlib import closing
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from actors.cli_options import DEFAULT_ENDPOINT, Fidelity
from common.cli import CommandApp, Version, command_errors, completing
from common.errors import ConfigError, MessageError
from common.extensions import SIMULATORS
from common.ids import check_id
from common.system.addresses import MAX_PORT, check_free, listening_address
from common.system.logs import setup_logging

if TYPE_CHECKING:
    from actors.launching import Launcher
    from common.config import BusConfig
    from common.messages.replies import Spec

log = logging.getLogger(__name__)

app = CommandApp(add_completion=True, no_args_is_help=False, pretty_exceptions_enable=False)

EXAMPLES = """
Examples:

  hd-actor --num 8                                    eight actors for the run on this machine

  hd-actor --num 8 --connect tcp/192.168.1.5:7447     the same for a learner on another machine

  hd-actor --num 2 --sim grid                         without PyBullet

  hd-actor --num 64 --launcher ray --connect tcp/192.168.1.5:7447     on the machines of a Ray cluster

  hd-actor --evaluate                                 run the validation worlds with each new policy

  hd-actor --gui --fidelity dynamic                   watch one robot drive
"""


class LogLevel(StrEnum):
    """How much is logged."""

    DEBUG = "debug"
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


class Launching(StrEnum):
    """Where the processes run."""

    LOCAL = "local"
    RAY = "ray"


@app.command(epilog=EXAMPLES)
@command_errors
def main(
    num: Annotated[int, typer.Option("--num", "-n", min=1, max=1024, help="Number of actors (processes).")] = 1,
    connect: Annotated[
        list[str] | None,
        typer.Option(help=f"Endpoint of the learner, or of a Zenoh router. [default: {DEFAULT_ENDPOINT}]"),
    ] = None,
    run: Annotated[str | None, typer.Option(help="Name of the run; optional if there is exactly one.")] = None,
    sim: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Simulator, instead of the run's: pybullet, grid, one that a package adds, or MODULE:CLASS.",
            autocompletion=completing(SIMULATORS),
        ),
    ] = None,
    fidelity: Annotated[Fidelity | None, typer.Option(help="Fidelity of PyBullet, instead of the run's.")] = None,
    maps: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SOURCE",
            help="Source of worlds, instead of the run's: folder or file of maps, or generator:NAME. May be repeated.",
        ),
    ] = None,
    evaluate: Annotated[
        bool, typer.Option("--evaluate", help="Act greedily in the validation worlds; report, but train nothing.")
    ] = False,
    allow: Annotated[
        list[str] | None,
        typer.Option(
            metavar="MODULE:CLASS",
            help="Simulator, task or generator of your own that the run may name: an actor loads no module that only "
            "the learner names. May be repeated.",
        ),
    ] = None,
    gui: Annotated[bool, typer.Option("--gui", help="Open PyBullet's window (needs a display).")] = False,
    name: Annotated[
        str | None, typer.Option(metavar="PREFIX", help="Names are PREFIX-0, PREFIX-1, ... [default: the host's name]")
    ] = None,
    launcher: Annotated[
        Launching, typer.Option(help="Where the processes run: on this machine, or on those of a Ray cluster.")
    ] = Launching.LOCAL,
    ray_address: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Head of the Ray cluster. [default: RAY_ADDRESS, else the cluster that this machine belongs to]",
        ),
    ] = None,
    compress: Annotated[
        bool, typer.Option("--compress", help="Compress the link, where its other end has bus.compression on.")
    ] = False,
    tls_ca: Annotated[str | None, typer.Option(help="Root certificate (PEM) of the run's authority.")] = None,
    tls_certificate: Annotated[str | None, typer.Option(help="This host's certificate (PEM).")] = None,
    tls_key: Annotated[str | None, typer.Option(help="This host's private key (PEM).")] = None,
    metrics: Annotated[
        str | None,
        typer.Option(
            metavar="[HOST:]PORT",
            help="Serve figures for Prometheus; of several actors each on the port after the last.",
        ),
    ] = None,
    log_level: Annotated[LogLevel | None, typer.Option(help="How much is logged. [default: info]")] = None,
    version: Version = False,
) -> None:
    """Run simulated robots that collect experience for a learner.

    Everything about the run comes from the learner, so an actor needs no more than its endpoint. Actors join and
    leave at any time, continue while the learner is away, and with --run wait for one that has not started yet.
    Ctrl-C ends them within three seconds.
    """
    del version
    from actors.launching import compile_kernels
    from actors.options import ActorOptions, host_name
    from actors.supervisor import Supervisor

    setup_logging(None if log_level is None else log_level.value)
    if sim is not None:
        SIMULATORS.check(sim)
    if gui and num > 1:
        raise ConfigError(f"--gui opens one window: use it with --num 1, not --num {num}")
    if gui and sim == "grid":
        raise ConfigError("--gui shows PyBullet's window: leave it out, or use --sim pybullet")
    if gui and launcher is Launching.RAY:
        raise ConfigError("--gui opens a window on this machine: leave it out, or use --launcher local")
    if ray_address is not None and launcher is not Launching.RAY:
        raise ConfigError("--ray-address goes with --launcher ray: add that, or leave the address out")
    address = None if metrics is None else listening_address(metrics, "--metrics")
    if address is not None and address[1] + num - 1 > MAX_PORT:
        raise ConfigError(
            f"--metrics {metrics} with --num {num} needs ports up to {address[1] + num - 1}, and {MAX_PORT} is the "
            "last: begin at a lower one"
        )
    if address is not None and launcher is Launching.LOCAL:
        for number in range(num):
            check_free(address[0], address[1] + number, "--metrics")
    prefix = _checked_id(name or host_name(), "--name")
    bus = _bus(connect, tls_ca, tls_certificate, tls_key, compress)
    run_name, taken, spec = _find_run(bus, run)
    common = {
        "run": run_name,
        "bus": bus,
        "evaluate": evaluate,
        "simulator": sim,
        "fidelity": None if fidelity is None else fidelity.value,
        "maps": tuple(maps or ()),
        "allow": tuple(allow or ()),
        "gui": gui,
        "log_level": None if log_level is None else log_level.value,
        "parent": os.getpid(),
    }
    names = [_checked_id(each, "--name") for each in free_names(prefix + ("-eval" if evaluate else ""), num, taken)]
    options = [
        ActorOptions.model_validate({**common, "name": each, "metrics": address and (address[0], address[1] + number)})
        for number, each in enumerate(names)
    ]
    # What this machine cannot do is said here, once, and not by each process.
    config = None if spec is None else options[0].accept(spec.config)
    if num > 1 and launcher is Launching.LOCAL:
        compile_kernels(None if config is None else config.network.model_dump_json())
    with closing(_launcher(launcher, ray_address)) as starter:
        role = "evaluators" if evaluate else "actors"
        log.info("starting %d %s for run %r: %s", num, role, run_name, ", ".join(names))
        code = Supervisor(options, starter).run()
    raise typer.Exit(code)


def _launcher(kind: Launching, ray_address: str | None) -> Launcher:
    if kind is Launching.RAY:
        from actors.ray_launcher import RayLauncher

        return RayLauncher(ray_address)
    from actors.launching import LocalLauncher

    return LocalLauncher()


def free_names(prefix: str, count: int, taken: frozenset[str]) -> list[str]:
    """Return the first ``count`` names PREFIX-k that are free on the bus."""
    names: list[str] = []
    number = 0
    while len(names) < count:
        candidate = f"{prefix}-{number}"
        if candidate not in taken:
            names.append(candidate)
        number += 1
    return names


def _bus(
    connect: list[str] | None, tls_ca: str | None, tls_certificate: str | None, tls_key: str | None, compress: bool
) -> BusConfig:
    from pydantic import ValidationError

    from common.config import BusConfig
    from common.config.endpoint import check_endpoint

    endpoints = tuple(connect or [DEFAULT_ENDPOINT])
    for endpoint in endpoints:
        try:
            check_endpoint(endpoint)
        except ValueError as error:
            raise ConfigError(f"--connect: {error}, got {endpoint!r}") from None
    try:
        return BusConfig(
            connect=endpoints,
            tls_ca=tls_ca,
            tls_certificate=tls_certificate,
            tls_key=tls_key,
            compression=compress,
        )
    except ValidationError as error:
        raise ConfigError("--tls-ca, --tls-certificate and --tls-key go together: give all three or none") from error


def _find_run(bus: BusConfig, run: str | None) -> tuple[str, frozenset[str], Spec | None]:
    """Return the run to join, the names of the processes that are there already, and its specification.

    A run that was named need not be there yet; then there is no specification.
    """
    from common.bus.liveness import present
    from common.bus.session import open_client_session
    from common.bus.spec import list_runs

    with open_client_session(bus, bus.connect) as session:
        try:
            runs = {spec.run: spec for spec in list_runs(session)}
        except MessageError as error:
            if run is None:
                raise
            # The run that was named may come yet, and its actors tell what they cannot read of it.
            log.warning("skipped a run: %s", error)
            runs = {}
        if run is None:
            if not runs:
                others = "" if bus.tls_ca is None else " (one whose certificate is of another authority never answers)"
                raise ConfigError(
                    f"no learner answers at {', '.join(bus.connect)}{others}: start one with 'hd-learner start', give "
                    "its endpoint with --connect, or name the run with --run to wait for its learner"
                )
            if len(runs) > 1:
                raise ConfigError(f"there are several runs, choose one with --run: {', '.join(sorted(runs))}")
            run = next(iter(runs))
        _checked_id(run, "--run")
        return run, frozenset(name for _, name in present(session, run)), runs.get(run)


def _checked_id(value: str, option: str) -> str:
    try:
        return check_id(value, option)
    except ValueError as error:
        raise ConfigError(str(error)) from None
