"""Options that several commands of `hd-deploy` have, and the parameters that they resolve to."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.presets import names_in

if TYPE_CHECKING:
    from deploy.config import DeployConfig

_PROFILES = names_in(Path(__file__).parent / "profiles")

Profile = Annotated[
    str | None,
    typer.Option("--profile", help=f"Shipped parameters to build upon: {', '.join(_PROFILES)}. [default: bare]"),
]
ConfigFile = Annotated[Path | None, typer.Option("--config", help="TOML or JSON file with parameters.", metavar="FILE")]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", help="One parameter; may be repeated.", metavar="SECTION.FIELD=VALUE"),
]
Connect = Annotated[
    list[str] | None,
    typer.Option("--connect", help="Endpoint of the robot's Zenoh router. [default: ros.connect]", metavar="ENDPOINT"),
]
RobotName = Annotated[str | None, typer.Option("--name", help="Name of the robot. [default: name]")]
LogLevel = Annotated[str | None, typer.Option("--log-level", help="debug, info, warning or error.")]


def load_options(
    profile: str | None,
    file: Path | None,
    overrides: Sequence[str] | None,
    connect: Sequence[str] | None = None,
    name: str | None = None,
    extra: Sequence[str] = (),
) -> DeployConfig:
    """Resolve the parameters; dedicated options override --set."""
    from deploy.profiles import load_deploy_config

    every = [*(overrides or ()), *extra]
    if connect:
        every.append(f"ros.connect={','.join(connect)}")
    if name is not None:
        every.append(f"name={name}")
    return load_deploy_config(file, every, os.environ, profile)
