"""Joining the robot's Zenoh network."""

from __future__ import annotations

import json
import logging
import threading
from typing import Any

import zenoh

from common.bus.endpoint import is_loopback
from common.bus.session import reason
from common.bus.tls import access_settings, tls_settings
from common.config.endpoint import ROBOT_PROTOCOLS, check_endpoint
from common.system.logs import lasting
from deploy.network_config import RosConfig
from deploy.ros2.errors import RosError

log = logging.getLogger(__name__)

MAX_MESSAGE = 64 << 20
"""Larger messages are refused before anything is allocated for them, bytes."""
LOOPBACK = "tcp/127.0.0.1:0"
"""Where a peer listens for the others of its machine."""
CLIENT_TIMEOUT = 2000
"""How long one attempt of a client to connect may last, milliseconds: Zenoh cannot be interrupted meanwhile."""


def open_session(config: RosConfig, *, wait: bool = True) -> zenoh.Session:
    """Open a session: a router where `listen` is set, else a peer or a client.

    - A peer talks to the other nodes directly, as the nodes of rmw_zenoh do: routers do not pass messages on between
      peers. It listens on the loopback, gossips, returns at once and never stops trying to connect.
    - A client needs a router, which passes on everything from and to clients. It waits until the router is there;
      afterwards it never stops trying to connect.

    Args:
        config: endpoints and mode.
        wait: whether a client waits for its router.

    Raises:
        RosError: when an endpoint is malformed, or taken, or a client that is not to wait finds no router.
    """
    for endpoint in (*config.connect, *config.listen):
        # Options of some commands get here past the validation of the settings.
        try:
            check_endpoint(endpoint, ROBOT_PROTOCOLS)
        except ValueError as error:
            raise RosError(f"{error}, got {endpoint!r}") from None
    if config.listen:
        return _open(config, "router", config.listen, -1)
    local = all(is_loopback(endpoint) for endpoint in config.connect)
    if config.mode == "peer" or (config.mode == "auto" and local):
        return _open(config, "peer", (LOOPBACK,), -1)
    waited, joined = False, threading.Event()
    while True:
        try:
            session = _open(config, "client", (), CLIENT_TIMEOUT)
            joined.set()
            return session
        except RosError as error:
            if not wait or ("imeout" not in str(error) and "Unable to connect" not in str(error)):
                raise
            if not waited:
                waits = lasting(lambda: not joined.is_set())
                log.warning("waiting for the Zenoh router at %s", ", ".join(config.connect), extra=waits)
            waited = True


def _open(config: RosConfig, mode: str, listen: tuple[str, ...], timeout: int) -> zenoh.Session:
    link: dict[str, Any] = {"tx": {"lease": 2000}, "rx": {"max_message_size": MAX_MESSAGE}}
    if config.tls_ca is not None:
        # With certificates nothing may enter beside TLS.
        link |= {"protocols": ["tls"], "tls": tls_settings(config)}
    settings: dict[str, Any] = {
        "mode": mode,
        "listen": {"endpoints": [_secured(endpoint, config) for endpoint in listen]},
        "connect": {
            "endpoints": [_secured(endpoint, config) for endpoint in config.connect if endpoint not in listen],
            "timeout_ms": timeout,
            "exit_on_failure": False,
            "retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2},
        },
        "scouting": {
            "multicast": {"enabled": False},
            "gossip": {"enabled": True},
            # How long opening waits for links: a router waits for nobody.
            "delay": 0 if mode == "router" else 100,
        },
        # Latched publishers tell messages apart by their time.
        "timestamping": {"enabled": True},
        "transport": {
            "link": link,
            "shared_memory": {"enabled": False},
        },
    }
    if config.tls_access is not None and mode == "router":
        settings["access_control"] = access_settings(config)
    open_to = [endpoint for endpoint in listen if not is_loopback(endpoint)]
    if open_to and config.tls_ca is None:
        log.warning(
            "listening on %s without TLS: anyone who can reach this address can command the robot and send it "
            "velocities; set ros.tls_ca, ros.tls_certificate and ros.tls_key, or listen on 127.0.0.1",
            ", ".join(open_to),
        )
    try:
        return zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))
    except zenoh.ZError as error:
        endpoints = ", ".join(listen or config.connect)
        raise RosError(
            f"cannot join Zenoh at {endpoints}: {reason(error)}; correct ros.listen or ros.connect"
        ) from None


def _secured(endpoint: str, config: RosConfig) -> str:
    """Return an endpoint; with TLS files, tcp becomes tls."""
    protocol, _, address = endpoint.partition("/")
    if config.tls_ca is not None and protocol == "tcp":
        return f"tls/{address}"
    return endpoint
