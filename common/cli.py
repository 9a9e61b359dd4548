"""What all commands share: errors as one clear line, Ctrl-C without a traceback, the version, completion of names."""

from __future__ import annotations

import errno
import functools
import inspect
import io
import re
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, Final, ParamSpec, TypeVar

import typer

from common.errors import HDError, StorageError
from common.registry import Registry
from common.system.extras import MissingPackageError, extras_with, package_of
from common.system.printable import printable

if TYPE_CHECKING:
    # Imported where something is shown: help needs none of it.
    from rich.console import Console
    from rich.table import Table

P = ParamSpec("P")
R = TypeVar("R")
F = TypeVar("F", bound=Callable[..., Any])

EXIT_ERROR = 1
EXIT_INTERRUPTED = 130
# Help is as wide as the terminal, up to this.
_HELP_COLUMNS: Final = 120
# Before a paragraph of a help text whose lines stay as they are.
_RAW: Final = "\b"
_LISTED: Final = re.compile(r"^(?:- |  )", re.MULTILINE)
# Wide enough for every table of ours.
_PIPE_COLUMNS: Final = 400
# What the system says of a full disk, and of a full quota.
_NO_ROOM: Final = (errno.ENOSPC, errno.EDQUOT)
# What it says of a place that a user named, and that cannot be written to, or is something else.
_REFUSED: Final = (
    errno.EACCES,
    errno.EEXIST,
    errno.EISDIR,
    errno.ELOOP,
    errno.ENAMETOOLONG,
    errno.ENOTDIR,
    errno.EPERM,
    errno.EROFS,
)
# Which extra the commands of a folder ask for when several bring the package.
_FIRST_EXTRA: Final = {"actors": "actor", "learner": "learner", "deploy": "robot"}


def output_console() -> Console:
    """Return a console on standard output whose tables stay whole: a pipe or a file has no width.

    Without emoji: `:office:` would become a house, and generators have such names.
    """
    from rich.console import Console

    console = Console(emoji=False, highlight=False)
    return console if console.is_terminal else Console(emoji=False, highlight=False, width=_PIPE_COLUMNS)


def message_console() -> Console:
    """Return a console on standard error, for progress, warnings and errors."""
    from rich.console import Console

    return Console(stderr=True, emoji=False, highlight=False)


def whole_table(*titles: str, **options: Any) -> Table:
    """Return a table that folds long words instead of cutting them.

    Args:
        titles: of the columns.
        options: other arguments of `rich.table.Table`.
    """
    from rich.table import Column, Table

    return Table(*(Column(title, overflow="fold") for title in titles), **options)


class CommandApp(typer.Typer):
    """A command with subcommands, whose output every terminal can show.

    What the terminal's encoding lacks (a C or Latin-1 locale, a redirected stream) is written as its number, such as
    ``\\u2265``, and does not end the command.

    Help is plain text: formatting it with Rich takes longer than all else that help needs, and takes what stands in
    brackets, such as defaults, for its own markup.
    """

    def __init__(self, **options: Any) -> None:
        """Make one with the options of `typer.Typer`."""
        options["context_settings"] = {"max_content_width": _HELP_COLUMNS, **(options.get("context_settings") or {})}
        super().__init__(rich_markup_mode=None, **options)

    def command(self, name: str | None = None, **options: Any) -> Callable[[F], F]:
        """Register a subcommand; see `typer.Typer.command`. In its help, examples stay on lines of their own."""

        def register(function: F) -> F:
            texts = {"help": options.get("help") or inspect.getdoc(function), "epilog": options.get("epilog")}
            kept = {name: with_lines_kept(text) for name, text in texts.items() if text}
            return super(CommandApp, self).command(name, **{**options, **kept})(function)

        return register

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Run the command that the arguments name; see `typer.Typer`."""
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="backslashreplace")
        return super().__call__(*args, **kwargs)


def with_lines_kept(text: str) -> str:
    """Return a help text whose lists and indented lines are marked to be shown line by line, as they are written."""
    marked = [f"{_RAW}\n{part}" if _LISTED.search(part) else part for part in re.split(r"\n\s*\n", text.strip("\n"))]
    return "\n\n".join(marked)


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
            if error.errno in _REFUSED and error.filename:
                raise _ended_by(
                    StorageError(
                        f"cannot use {error.filename} ({error.strerror}): check its permissions, or name another place"
                    )
                ) from None
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
    from rich.markup import escape

    words = escape(printable(str(error), lines=True))
    message_console().print("[bold red]error:[/]", words, soft_wrap=True)
    return typer.Exit(EXIT_ERROR)
