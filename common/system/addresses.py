"""Where a server of this process listens, as options of commands give it."""

from __future__ import annotations

import os
import re
import socket
from typing import Final

from common.errors import ConfigError

LOOPBACK: Final = "127.0.0.1"
MAX_PORT: Final = 65535


def listening_address(text: str, option: str) -> tuple[str, int]:
    """Read ``PORT``, ``HOST:PORT`` or ``[IPV6]:PORT``; a port alone is open to this machine only.

    Args:
        text: as it was given.
        option: that it was given with, for the message.

    Raises:
        ConfigError: for anything else.
    """
    found = re.fullmatch(r"(?:(\[[0-9a-fA-F:.]+\]|[A-Za-z0-9.-]+):)?([0-9]{1,5})", text.strip())
    if found is None or int(found[2]) > MAX_PORT:
        raise ConfigError(f"{option} must be PORT or HOST:PORT, such as 8080 or 192.168.1.5:8080, got {text!r}")
    return (found[1] or LOOPBACK).strip("[]"), int(found[2])


def check_free(host: str, port: int, option: str) -> None:
    """Try to listen somewhere, and stop again: where that fails nobody should wait for it until all else is prepared.

    Args:
        host: a name or an address of this machine.
        port: 0 for any.
        option: that it was given with, for the message.

    Raises:
        ConfigError: the port is taken, or the address is not of this machine.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        socket.create_server((host, port), family=family).close()
    except OSError as error:
        # What the system says names the address again, in Python's words.
        words = os.strerror(error.errno) if error.errno else str(error)
        raise ConfigError(f"{option} cannot listen on {host}:{port}: {words}: give another port or host") from None
