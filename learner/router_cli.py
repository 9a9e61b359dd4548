"""The command `hd-learner router`."""

from __future__ import annotations

import os
from typing import Annotated

import typer

from common.cli import command_errors
from common.system.logs import setup_logging
from common.system.runtime import restart_prepared


@command_errors
def router(
    connect: Annotated[
        list[str], typer.Option("--connect", help="Endpoint of the learner or a router; may be repeated.")
    ],
    listen: Annotated[
        str, typer.Option("--listen", help="Endpoint on which actors find this router.", metavar="ENDPOINT")
    ] = "tcp/127.0.0.1:7448",
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", help="Settings of the bus, such as bus.tls_ca=pki/ca.pem.", metavar="BUS.FIELD=VALUE"),
    ] = None,
    log_level: Annotated[
        str | None, typer.Option("--log-level", help="debug, info, warning or error.", metavar="LEVEL")
    ] = None,
) -> None:
    """Join a site's actors to a learner elsewhere: one link between the sites instead of one for each actor.

    With `bus.tls_access` the run's access rules hold here too.


    Examples:
    - `hd-learner router --listen tcp/0.0.0.0:7447 --connect tcp/learner.example:7447`

    - `hd-learner router --listen tls/0.0.0.0:7447 --connect tls/learner.example:7447 --set bus.tls_ca=pki/ca.pem
      --set bus.tls_certificate=pki/learner.pem --set bus.tls_key=pki/learner.key --set bus.tls_access=pki/access.json`
    """
    restart_prepared()
    from common.config import load_config
    from learner.router import run_router

    changes = [*(overrides or []), f"bus.listen={listen}", f"bus.connect={','.join(connect)}"]
    bus = load_config(None, changes, os.environ).bus
    setup_logging(log_level)
    run_router(bus)
