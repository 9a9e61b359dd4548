"""Joining the robot's Zenoh network."""

from __future__ import annotations

import json
import logging
from typing import Any

import zenoh

from deploy.config import RosConfig
from deploy.ros2.errors import RosError

log = logging.getLogger(__name__)

MAX_MESSAGE = 64 << 20
"""Larger messages are refused before anything is allocated for them, bytes."""


def open_session(config: RosConfig) -> zenoh.Session:
    """Open a session: a peer that never stops trying to connect, or a router where `listen` is set.

    Returns at once whether or not anybody is there. Peers listen on the loopback and gossip, as those of rmw_zenoh
    do: a router passes nothing on between peers that do not gossip.

    Raises:
        RosError: when an endpoint is malformed or taken.
    """
    if not config.connect and not config.listen:
        raise RosError("ros.connect or ros.listen needs an endpoint, such as tcp/127.0.0.1:7447")
    settings: dict[str, Any] = {
        "mode": "router" if config.listen else "peer",
        "listen": {"endpoints": list(config.listen or ("tcp/127.0.0.1:0",))},
        "connect": {
            "endpoints": [endpoint for endpoint in config.connect if endpoint not in config.listen],
            "timeout_ms": -1,
            "exit_on_failure": False,
            "retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2},
        },
        "scouting": {
            "multicast": {"enabled": False},
            "gossip": {"enabled": True},
            "delay": 0 if config.listen else 100,
        },
        # Advanced publishers number and time their messages.
        "timestamping": {"enabled": True},
        "transport": {
            "link": {"tx": {"lease": 2000}, "rx": {"max_message_size": MAX_MESSAGE}},
            "shared_memory": {"enabled": False},
        },
    }
    try:
        return zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))
    except zenoh.ZError as error:
        endpoints = ", ".join(config.listen or config.connect)
        raise RosError(
            f"cannot open a Zenoh session at {endpoints}: {error}; correct ros.listen or ros.connect"
        ) from None
