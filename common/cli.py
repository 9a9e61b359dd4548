"""What all commands share: errors as one clear line, Ctrl-C without a traceback, the version, completion of names."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from typing import Annotated, ParamSpec, TypeVar

import typer
from rich.console import Console

from common.errors import HDError
from common.printable import printable
from common.registry import Registry

P = ParamSpec("P")
R = TypeVar("R")

EXIT_ERROR = 1
EXIT_INTERRUPTED = 130


def command_errors(function: Callable[P, R]) -> Callable[P, R]:
    """Turn the errors that a user can act on into one red line and exit code 1."""

    @functools.wraps(function)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return function(*args, **kwargs)
        except HDError as error:
            # Without emoji: the one of `:office:` is a house, and generators have such names.
            console = Console(stderr=True, highlight=False, soft_wrap=True, emoji=False)
            console.print(f"[bold red]error:[/] {_plain(str(error))}")
            raise typer.Exit(EXIT_ERROR) from None
        except KeyboardInterrupt:
            sys.stderr.write("interrupted\n")
            raise typer.Exit(EXIT_INTERRUPTED) from None

    return wrapped


def version_text() -> str:
    """Return what ``--version`` prints."""
    try:
        return f"hdplanner {version('hdplanner')}"
    except PackageNotFoundError:
        return "hdplanner, run from a checkout that is not installed"


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(version_text())
        raise typer.Exit


Version = Annotated[
    bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit.")
]
"""The option of commands without subcommands; `add_version` gives it to the others."""


def add_version(app: typer.Typer) -> None:
    """Give a command with subcommands the option ``--version``."""

    @app.callback()
    def main(version: Version = False) -> None:
        del version


def completing(registry: Registry) -> Callable[[str], list[str]]:
    """Return a completion of names for an option of the command line."""

    def complete(incomplete: str) -> list[str]:
        return [name for name in registry.names() if name.startswith(incomplete)]

    return complete


def _plain(text: str) -> str:
    return printable(text, lines=True).replace("[", "\\[")
