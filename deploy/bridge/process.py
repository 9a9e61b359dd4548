"""The life of a bridge process: it runs until a signal ends it."""

from __future__ import annotations

import logging
import threading

from common.system.signals import stopping_signals
from deploy.bridge.bridge import Bridge
from deploy.config import DeployConfig

log = logging.getLogger(__name__)


def run_bridge(config: DeployConfig) -> None:
    """Run a bridge until SIGINT or SIGTERM.

    Raises:
        HDError: it cannot start.
    """
    stop = threading.Event()
    # What prepares the bridge takes a minute on a fresh installation: there a signal raises, as in any command that
    # starts. Once the bridge is there it stops in order, and is closed before signals raise again.
    with Bridge(config) as bridge, stopping_signals(stop.set, stop.is_set), bridge:
        log.info(
            "robot %r: %s by %s, %s; waiting for %s",
            config.name,
            config.decision.task,
            config.decision.planner,
            "driving itself" if config.driving.enabled else "the robot's own stack drives",
            "map and pose" if config.decision.autostart else "the command to start",
        )
        bridge.run(stop)
        log.info("the bridge ends")
