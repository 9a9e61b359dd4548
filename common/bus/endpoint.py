"""What Zenoh endpoints such as tcp/127.0.0.1:7447 mean to this machine."""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Iterable
from typing import Final

from common.errors import BusError

_ON_TCP: Final = ("tcp", "tls", "ws")


def is_loopback(endpoint: str) -> bool:
    """Whether an endpoint can be reached from this machine alone."""
    protocol, address = endpoint.split("/", 1)
    if protocol == "unixsock-stream":
        return True
    host = address.rsplit(":", 1)[0].strip("[]")
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def require_free(endpoints: Iterable[str]) -> None:
    """Make sure that this process could listen at endpoints now, before it prepares what takes long.

    Args:
        endpoints: well-formed ones; what is no port of TCP is left to Zenoh.

    Raises:
        BusError: another process listens at one, or it is none of this machine's addresses.
    """
    for endpoint in endpoints:
        protocol, _, rest = endpoint.partition("/")
        if protocol not in _ON_TCP:
            continue
        host, _, port = rest.partition("?")[0].partition("#")[0].rpartition(":")
        try:
            family, _, _, _, address = socket.getaddrinfo(host.strip("[]"), int(port), type=socket.SOCK_STREAM)[0]
            socket.create_server(address[:2], family=family).close()
        except OSError as error:
            raise BusError(why_not_listening(endpoint, str(error))) from None


def why_not_listening(endpoint: str, error: str) -> str:
    """Return in a sentence why a process cannot listen at an endpoint, and what to do.

    Args:
        endpoint: such as tcp/127.0.0.1:7447.
        error: what the operating system, or Zenoh, says.
    """
    if "in use" in error:
        return f"{endpoint} is in use by another process: stop it, or choose another port (--listen tcp/127.0.0.1:7448)"
    if "assign requested address" in error:
        return f"this machine has no address {endpoint}: listen on one that it has, such as tcp/127.0.0.1:7447"
    return f"cannot listen on {endpoint}: {error}"
