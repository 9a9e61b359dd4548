"""The life of a relay process: it runs until a signal ends it."""

from __future__ import annotations

import logging
import threading

from common.system.signals import stopping_signals
from deploy.config import DeployConfig
from deploy.network_config import router_for_bridge
from deploy.relay.relay import Relay

log = logging.getLogger(__name__)


def run_relay(config: DeployConfig) -> None:
    """Run a relay until SIGINT or SIGTERM.

    Raises:
        HDError: it cannot start.
    """
    stop = threading.Event()
    with stopping_signals(stop.set, stop.is_set), Relay(config) as relay:
        ros = config.ros
        where = ", ".join(ros.listen or ros.connect)
        log.info(
            "robot %r: DDS domain %d as %s, Zenoh %s %s",
            config.name,
            relay.domain,
            ros.node,
            "router at" if ros.listen else "at",
            where,
        )
        relay.run(stop)
        log.info("the relay ends: %s", relay.counters())


def as_router(config: DeployConfig) -> DeployConfig:
    """Return the configuration of a relay that is the router which the bridge connects to.

    A robot on DDS has no Zenoh router of its own, so the relay listens where the bridge is told to connect.

    Raises:
        ConfigError: that is another machine.
    """
    return config.model_copy(update={"ros": router_for_bridge(config.ros, "the relay")})
