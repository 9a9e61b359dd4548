"""Reading Zenoh endpoints, such as tcp/127.0.0.1:7447."""

from __future__ import annotations

import ipaddress


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
