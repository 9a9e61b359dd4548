"""`hd-learner page`: the page of a run whose learner runs already, here or elsewhere."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from common.cli import command_errors
from common.page.options import TokenOption, announcement, page_settings
from common.system.extras import optional
from common.system.logs import setup_logging
from learner.remote_cli import Connect, Overrides, RunName

_LOOK_SECONDS = 3.0


@command_errors
def page(
    address: Annotated[
        str, typer.Argument(help="Where to serve it; the host is 127.0.0.1 when not given.", metavar="[HOST:]PORT")
    ] = "8080",
    run: RunName = None,
    connect: Connect = None,
    overrides: Overrides = None,
    token: TokenOption = None,
    runs: Annotated[
        Path, typer.Option("--runs", help="Folder of runs: what a run there has done is shown too.", metavar="FOLDER")
    ] = Path("runs"),
    log_level: Annotated[str | None, typer.Option("--log-level", help="debug, info, warning or error.")] = None,
) -> None:
    """Watch and command a training in a browser. Ctrl-C ends the page; the training continues.

    Examples:
    - `hd-learner page` shows the run that is live on this machine, at http://127.0.0.1:8080/.

    - `hd-learner page 9000 --run office --connect tcp/192.168.1.5:7447`
    """
    setup_logging(log_level)
    with optional("the page", "page"):
        from common.page.serve import serve
    from common.bus.session import open_client_session
    from common.config import load_config
    from learner.page.process import SITE
    from learner.page.source import Training
    from learner.watch.asking import only_run

    settings = page_settings(address, token)
    bus = load_config(None, overrides or (), os.environ).bus
    endpoints = [connect] if connect else None
    if run is None:
        with open_client_session(bus, endpoints) as session:
            run = only_run(session, _LOOK_SECONDS)
    folder = runs / run
    source = Training(bus, endpoints, run, folder if (folder / "run.json").is_file() else None)
    serve(settings, SITE, source, lambda at: typer.echo(announcement(at, settings)))
