"""Joining the bus: the learner embeds a router, everybody else is a peer that never gives up."""

from __future__ import annotations

import contextlib
import json
import logging
import re
import secrets
import socket
import time
from collections.abc import Iterable, Iterator
from typing import Any

import zenoh

from common.bus.endpoint import is_loopback, why_not_listening
from common.bus.gate import LISTENERS, Gate
from common.bus.tls import access_settings, tls_settings
from common.config import BusConfig
from common.config.endpoint import check_endpoint
from common.errors import BusError
from common.messages.weights import MAX_WEIGHTS
from common.system.runtime import allow_files

log = logging.getLogger(__name__)

MAX_SESSIONS = 10_000
"""Processes that the learner's router takes; Zenoh's own default is 1,000."""
MAX_PENDING = 4_000
"""Connections that may be about to become sessions."""
ACCEPT_SECONDS = 3.0
"""For them to do so."""
VIEWER_SECONDS = 3.0
"""For whoever looks at actors to reach the learner."""
MAX_FILES = 65_536


def new_incarnation() -> int:
    """Return a random number that tells this process from its predecessors of the same name."""
    return secrets.randbits(63)


@contextlib.contextmanager
def open_learner_session(config: BusConfig) -> Iterator[zenoh.Session]:
    """Open the learner's session: a router that listens, and joins existing routers if told to.

    With TLS a `Gate` holds the port, and the router listens behind it on loopback.

    Usage::

        with open_learner_session(config.bus) as session:
            ...

    Args:
        config: endpoints, lease, TLS files and access rules.

    Raises:
        BusError: when an endpoint is malformed or taken, or a file is missing.
    """
    listen = _endpoint(config.listen, config)
    guarded = listen.startswith("tls/")
    behind = free_ports(LISTENERS) if guarded else []
    endpoints = [f"tls/127.0.0.1:{port}" for port in behind] or [listen]
    settings = _settings(config, "router", endpoints, config.connect)
    settings["transport"]["unicast"] |= {
        "max_sessions": MAX_SESSIONS,
        # Connections that say nothing: with Zenoh's defaults a hundred of them shut everybody out for ten seconds.
        "accept_pending": MAX_PENDING,
        "accept_timeout": int(ACCEPT_SECONDS * 1000),
    }
    allow_files(MAX_FILES)
    if config.tls_access is not None:
        settings["access_control"] = access_settings(config)
    with contextlib.ExitStack() as stack:
        try:
            if guarded:
                host, _, port = listen.removeprefix("tls/").rpartition(":")
                stack.enter_context(Gate(host.strip("[]"), int(port), behind))
            session = zenoh.open(_zenoh_config(settings))
            stack.callback(_close, session)
        except (OSError, zenoh.ZError) as error:
            raise BusError(why_not_listening(listen, reason(error))) from None
        _warn_of_strangers(listen, config)
        yield session


def _close(session: zenoh.Session) -> None:
    try:
        session.close()
    except zenoh.ZError as error:
        # Thousands of connections that say nothing take longer than Zenoh waits; they end with the process.
        log.warning("closing the bus failed: %s", reason(error))


def free_ports(count: int) -> list[int]:
    """Return so many ports of loopback that nobody listens on at the moment."""
    with contextlib.ExitStack() as stack:
        probes = [stack.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in range(count)]
        return [probe.getsockname()[1] for probe in probes]


def _warn_of_strangers(listen: str, config: BusConfig) -> None:
    if not is_loopback(listen) and config.tls_ca is None:
        log.warning(
            "listening on %s without TLS: anyone who can reach this address can send experience and commands; create "
            "certificates with 'hd-learner certificates', or listen on 127.0.0.1",
            listen,
        )


def wait_for_routers(session: zenoh.Session, timeout: float) -> bool:
    """Wait until a session is linked to a router; return whether it is in time, seconds."""
    deadline = time.monotonic() + timeout
    while not session.info.routers_zid():
        if time.monotonic() >= deadline:
            return False
        time.sleep(0.05)
    return True


def open_client_session(config: BusConfig, connect: Iterable[str] | None = None) -> zenoh.Session:
    """Open the session of an actor, a robot or a command: it listens nowhere and never stops trying to connect.

    Returns at once whether or not the learner is there; tokens, subscriptions and queries work as soon as it is.

    Args:
        config: lease and TLS files.
        connect: endpoints of the learner or of routers; the learner's own `listen` and `connect` when not given.

    Raises:
        BusError: when an endpoint is malformed or a file is missing.
    """
    endpoints = [config.listen, *config.connect] if connect is None else list(connect)
    if not endpoints:
        raise BusError("an endpoint to connect to is needed, such as tcp/127.0.0.1:7447")
    settings = _settings(config, "peer", [], endpoints)
    try:
        return zenoh.open(_zenoh_config(settings))
    except zenoh.ZError as error:
        raise BusError(f"cannot open a session to {', '.join(endpoints)}: {reason(error)}") from None


def open_viewer_session(config: BusConfig, connect: Iterable[str] | None = None) -> zenoh.Session:
    """Open the session of somebody who looks at what actors send.

    A router passes nothing on from one peer to another, since peers that know of each other would talk directly; from a
    peer to a client it does. A client needs its learner: open this once that has answered.

    Args:
        config: lease and TLS files.
        connect: endpoints of the learner or of routers; the learner's own `listen` and `connect` when not given.

    Raises:
        BusError: nobody can be reached in time, an endpoint is malformed, or a file is missing.
    """
    endpoints = [config.listen, *config.connect] if connect is None else list(connect)
    settings = _settings(config, "client", [], endpoints)
    settings["connect"] |= {"timeout_ms": int(VIEWER_SECONDS * 1000), "exit_on_failure": True}
    try:
        return zenoh.open(_zenoh_config(settings))
    except zenoh.ZError as error:
        raise BusError(f"cannot look at the actors of {', '.join(endpoints)}: {reason(error)}") from None


def _endpoint(text: str, config: BusConfig) -> str:
    """Return a checked endpoint; with TLS files, tcp becomes tls."""
    try:
        protocol, _, address = check_endpoint(text).partition("/")
    except ValueError as error:
        raise BusError(f"{error}, got {text!r}") from None
    if config.tls_ca is not None and protocol == "tcp":
        return f"tls/{address}"
    if config.tls_ca is None and protocol == "tls":
        raise BusError(
            f"{text} needs certificates: set tls_ca, tls_certificate and tls_key "
            "('hd-learner certificates' makes the files)"
        )
    return text


def _settings(config: BusConfig, mode: str, listen: list[str], connect: Iterable[str]) -> dict[str, Any]:
    """Return Zenoh's settings; the measurements behind each are in docs/bus.md."""
    link: dict[str, Any] = {
        "tx": {"lease": int(config.lease * 1000)},
        "rx": {"max_message_size": MAX_WEIGHTS + (1 << 20)},
    }
    if config.tls_ca is not None:
        # With certificates nothing may enter beside TLS.
        link["protocols"] = ["tls"]
        link["tls"] = tls_settings(config)
    return {
        "mode": mode,
        "listen": {"endpoints": listen},
        "connect": {
            "endpoints": [_endpoint(text, config) for text in connect],
            "timeout_ms": -1,
            "exit_on_failure": False,
            "retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2},
        },
        # The delay is how long opening waits for links: a client waits briefly for its learner, which waits for nobody.
        "scouting": {
            "multicast": {"enabled": False},
            "gossip": {"enabled": False},
            "delay": 0 if mode == "router" else 100,
        },
        "transport": {
            "link": link,
            "shared_memory": {"enabled": config.shared_memory},
            "unicast": {"compression": {"enabled": config.compression}},
        },
    }


def _zenoh_config(settings: dict[str, Any]) -> zenoh.Config:
    try:
        return zenoh.Config.from_json5(json.dumps(settings))
    except zenoh.ZError as error:
        raise BusError(f"the bus settings are not valid: {reason(error)}") from None


def reason(error: Exception) -> str:
    """Return what an error of Zenoh says, without the places in its source that it names."""
    return re.sub(r"\s+at /\S+?\.rs:\d+\.?", "", str(error))
