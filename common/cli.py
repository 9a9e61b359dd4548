"""What all commands share: one clear line on error, a non-zero exit code, Ctrl-C without a traceback."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import typer
from rich.console import Console

from common.errors import HDError

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


def _plain(text: str) -> str:
    return text.replace("[", "\\[")
