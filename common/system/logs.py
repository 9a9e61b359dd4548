"""Logging: one line per event that matters, the same in every process."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable
from logging.handlers import RotatingFileHandler
from pathlib import Path
from typing import TYPE_CHECKING, Any

from common.system.printable import printable

if TYPE_CHECKING:
    from rich.console import Console

PLAIN_FORMAT = "%(asctime)s %(levelname)-7s %(name)s: %(message)s"
MAX_BYTES = 10_000_000
"""Size at which a log file is set aside and a new one begun."""
KEPT_FILES = 4
"""Files kept beside the newest."""


def lasting(holds: Callable[[], bool]) -> dict[str, Any]:
    """Return the ``extra`` of a log line about something that lasts, so that a status tells it for as long.

    Usage::

        log.error("the watchdog is dead", extra=lasting(lambda: not self.alive))

    Args:
        holds: whether it is still so; called from any thread, at any time.
    """
    return {"holds": holds}


class PrintableFormatter(logging.Formatter):
    """Shows what a terminal would obey, wherever in a line it came from; tracebacks keep their lines."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the text of one record."""
        return printable(super().format(record), lines=True)


class _LogFile(RotatingFileHandler):
    """A log of bounded size; on a full disk lines are missing from it, and the terminal has them all."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - a name of the standard library
        if not isinstance(sys.exc_info()[1], OSError):
            super().handleError(record)


def log_file(path: Path) -> logging.Handler:
    """Return a handler that writes plain lines into a file of bounded size: `path`, then `path`.1 and so on."""
    handler = _LogFile(path, maxBytes=MAX_BYTES, backupCount=KEPT_FILES, encoding="utf-8")
    handler.setFormatter(PrintableFormatter(PLAIN_FORMAT))
    return handler


def setup_logging(level: str | None = None, *, console: Console | None = None) -> None:
    """Send all log lines of this process to standard error.

    A terminal gets colours through Rich (share `console` with a live view, so that lines appear above it); anything
    else gets plain lines with time, level and logger.

    Args:
        level: debug, info, warning or error; the variable HD_LOG_LEVEL, else info, when not given.
        console: console of a live view.

    Raises:
        ValueError: for an unknown level.
    """
    name = (level or os.environ.get("HD_LOG_LEVEL") or "info").upper()
    number = logging.getLevelNamesMapping().get(name)
    if number is None:
        raise ValueError(f"log level must be debug, info, warning or error, got {name.lower()!r}")
    handler: logging.Handler
    if console is not None or sys.stderr.isatty():
        from rich.console import Console
        from rich.logging import RichHandler

        handler = RichHandler(console=console or Console(stderr=True), show_path=False, rich_tracebacks=False)
        handler.setFormatter(PrintableFormatter("%(name)s: %(message)s", datefmt="[%X]"))
    else:
        handler = logging.StreamHandler()
        handler.setFormatter(PrintableFormatter(PLAIN_FORMAT))
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(number)
    # numba reports every compiled function at debug level, which buries our own lines.
    logging.getLogger("numba").setLevel(logging.WARNING)
