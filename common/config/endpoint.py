"""Zenoh endpoints as settings and options give them, such as tcp/127.0.0.1:7447."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Annotated, Final

from pydantic import AfterValidator

BUS_PROTOCOLS: Final = ("tcp", "tls", "unixsock-stream")
"""Of the bus of a training."""
ROBOT_PROTOCOLS: Final = ("tcp", "tls", "udp", "ws", "unixsock-stream")
"""Of a robot's network: those that Zenoh's Python package brings and that need no settings of their own."""
_PATHS: Final = ("unixsock-stream",)


def check_endpoint(text: str, protocols: Sequence[str] = BUS_PROTOCOLS) -> str:
    """Return an endpoint that is one: PROTOCOL/HOST:PORT, or PROTOCOL/PATH, with Zenoh's own options behind it.

    Args:
        text: such as ``tcp/127.0.0.1:7447`` or ``tcp/[::1]:7447?rel=1#iface=eth0``.
        protocols: that are allowed.

    Raises:
        ValueError: it is none; the message says what was expected, not what came.
    """
    protocol, _, rest = text.partition("/")
    address = rest.partition("?")[0].partition("#")[0]
    if protocol in _PATHS:
        well_formed = bool(address)
    else:
        host, _, port = address.rpartition(":")
        well_formed = bool(host) and port.isascii() and port.isdigit() and int(port) < 65536
    if protocol not in protocols or not well_formed:
        *others, last = (f"{name}/{'PATH' if name in _PATHS else 'HOST:PORT'}" for name in protocols)
        raise ValueError(f"an endpoint must be {', '.join(others)} or {last}, such as tcp/192.168.1.5:7447")
    return text


BusEndpoint = Annotated[str, AfterValidator(check_endpoint)]
RobotEndpoint = Annotated[str, AfterValidator(functools.partial(check_endpoint, protocols=ROBOT_PROTOCOLS))]
