"""The log of a child process, line by line in ours."""

from __future__ import annotations

import logging
import re
from typing import IO

from common.system.threads import guarded

# A line of a log: name of the process (where it has one), time, level, logger, message.
_LOG_LINE = re.compile(r"(?:([a-z0-9-]+) \| )?[0-9-]+ [0-9:,]+ (DEBUG|INFO|WARNING|ERROR) +([\w.]+): (.*)")


def pass_on_log(lines: IO[str], logger: logging.Logger, whose: str) -> None:
    """Put the lines of a child into our log until it ends, each at its own level and without a second time.

    Args:
        lines: its output; closed at the end.
        logger: where they go.
        whose: the child, for the log of what fails here.
    """

    def pass_on(line: str) -> None:
        found = _LOG_LINE.fullmatch(line)
        if found is None:
            logger.info("%s", line)
        else:
            name, level, logger_name, message = found.groups()
            logger.log(logging.getLevelNamesMapping()[level], "%s", f"{name or logger_name}: {message}")

    safely = guarded(f"passing on the log of {whose}", pass_on)
    with lines:
        for line in lines:
            if line.strip():
                safely(line.rstrip())
