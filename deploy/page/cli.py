"""`hd-deploy page`: the page of robots that run already, or of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from common.cli import command_errors
from common.page.options import PageSettings, TokenOption, announcement, page_settings
from common.system.extras import optional
from common.system.logs import setup_logging
from deploy.cli_options import ConfigFile, Connect, LogLevel, Overrides, Profile, load_options


@command_errors
def page(
    address: Annotated[
        str, typer.Argument(help="Where to serve it; the host is 127.0.0.1 when not given.", metavar="[HOST:]PORT")
    ] = "8080",
    replay: Annotated[
        Path | None, typer.Option("--replay", help="Show this recording instead: a bag, or its file.", metavar="FILE")
    ] = None,
    token: TokenOption = None,
    connect: Connect = None,
    profile: Profile = None,
    config: ConfigFile = None,
    overrides: Overrides = None,
    log_level: LogLevel = None,
) -> None:
    """Watch and command robots in a browser. Ctrl-C ends the page; the robots continue.

    Examples:
    - `hd-deploy page` shows the robots that this machine's router knows, at http://127.0.0.1:8080/.

    - `hd-deploy page 9000 --connect tcp/192.168.1.5:7447 --profile cmu`

    - `hd-deploy page --replay recordings/lab` shows a recording, with a slider for the time.
    """
    setup_logging(log_level)
    with optional("the page", "page"):
        from common.page.serve import serve
    from deploy.page.process import SITE

    settings = page_settings(address, token)
    if replay is None:
        from deploy.page.source import Robots

        resolved = load_options(profile, config, overrides, connect)
        serve(settings, SITE, Robots(resolved), lambda at: announce(at, settings))
        return
    from deploy.page.replay import Replay
    from deploy.recording.reader import recorded_config

    recorded = None if profile or config else recorded_config(replay)
    resolved = recorded or load_options(profile, config, overrides, connect)
    serve(settings, SITE, Replay(replay, resolved), lambda at: announce(at, settings))


def announce(address: str, settings: PageSettings) -> None:
    """Print where a page is and, when the token was made for it, how to command there."""
    typer.echo(announcement(address, settings))
