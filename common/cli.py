"""What all commands share: errors as one clear line, Ctrl-C without a traceback, the version, completion of names."""

from __future__ import annotations

import errno
import functools
import io
import sys
from collections.abc import Callable
from typing import Annotated, Any, Final, ParamSpec, TypeVar

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

from common.errors import HDError, StorageError
from common.registry import Registry
from common.system.extras import MissingPackageError, extras_with, package_of
from common.system.printable import printable

P = ParamSpec("P")
R = TypeVar("R")

EXIT_ERROR = 1
EXIT_INTERRUPTED = 130
# Wide enough for every table of ours.
_PIPE_COLUMNS: Final = 400
# What the system says of a full disk, and of a full quota.
_NO_ROOM: Final = (errno.ENOSPC, errno.EDQUOT)
# Which extra the commands of a folder ask for when several bring the package.
_FIRST_EXTRA: Final = {"actors": "actor", "learner": "learner", "deploy": "robot"}


def output_console() -> Console:
    """Return a console on standard output whose tables stay whole: a pipe or a file has no width.

    Without emoji: `:office:` would become a house, and generators have such names.
    """
    console = Console(emoji=False, highlight=False)
    return console if console.is_terminal else Console(emoji=False, highlight=False, width=_PIPE_COLUMNS)


def message_console() -> Console:
    """Return a console on standard error, for progress, warnings and errors."""
    return Console(stderr=True, emoji=False, highlight=False)


def whole_table(*titles: str, **options: Any) -> Table:
    """Return a table that folds long words instead of cutting them.

    Args:
        titles: of the columns.
        options: other arguments of `rich.table.Table`.
    """
    return Table(*(Column(title, overflow="fold") for title in titles), **options)


class CommandApp(typer.Typer):
    """A command with subcommands, whose output every terminal can show.

    What the terminal's encoding lacks (a C or Latin-1 locale, a redirected stream) is written as its number, such as
    ``\\u2265``, and does not end the command.
    """

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Run the command that the arguments name; see `typer.Typer`."""
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="backslashreplace")
        return super().__call__(*args, **kwargs)


def command_errors(function: Callable[P, R]) -> Callable[P, R]:
    """Turn the errors that a user can act on into one red line and exit code 1."""

    @functools.wraps(function)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return function(*args, **kwargs)
        except HDError as error:
            raise _ended_by(error) from None
        except ModuleNotFoundError as error:
            package = package_of(error)
            extras = extras_with(package, _FIRST_EXTRA.get(function.__module__.partition(".")[0])) if package else ()
            if package is None or not extras:
                # A module of this project that is missing is a defect.
                raise
            raise _ended_by(MissingPackageError("this command", package, extras[:1])) from None
        except OSError as error:
            if error.errno not in _NO_ROOM:
                raise
            where = f" in writing {error.filename}" if error.filename else ""
            raise _ended_by(
                StorageError(f"{error.strerror}{where}: make room on the disk, or write to another one")
            ) from None
        except KeyboardInterrupt:
            sys.stderr.write("interrupted\n")
            raise typer.Exit(EXIT_INTERRUPTED) from None

    return wrapped


def version_text() -> str:
    """Return what ``--version`` prints."""
    # It brings a parser of e-mails, which help does not need.
    from importlib.metadata import PackageNotFoundError, version

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


def _ended_by(error: HDError) -> typer.Exit:
    """Print an error, and return what ends the command."""
    words = escape(printable(str(error), lines=True))
    message_console().print("[bold red]error:[/]", words, soft_wrap=True)
    return typer.Exit(EXIT_ERROR)
