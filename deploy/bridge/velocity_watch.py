"""Who else publishes on the velocity topic: two sources of velocities make a robot that nobody stops."""

from __future__ import annotations

import logging
from typing import Final

import zenoh

from common.system.closing import Closing
from common.system.logs import lasting
from deploy.network_config import RosConfig, TopicsConfig
from deploy.ros2 import Node
from deploy.ros2.graph import RMW_SELECTOR, SeenEndpoint, parse_token
from deploy.ros2.names import topic_name

log = logging.getLogger(__name__)

_ADVICE: Final = (
    "its velocities reach the wheels past the watchdog, in an emergency too: stop it, or put a multiplexer in between"
)


class VelocityWatch(Closing):
    """Warns of every node but the bridge's own that publishes where the watchdog sends velocities.

    Nodes behind a zenoh-bridge-ros2dds do not show who they are, and are not watched.

    Attributes:
        others: full names of the nodes that were seen.
    """

    def __init__(self, node: Node, ros: RosConfig, topics: TopicsConfig) -> None:
        """Watch the liveliness tokens of the robot's network."""
        self._topic = topic_name(topics.velocity, node.namespace, topics.remap)
        within = node.namespace.rstrip("/")
        self._own = {f"{within}/{name}" for name in (ros.node, f"{ros.node}_watchdog")}
        self.others: set[str] = set()
        self._subscriber = node.session.liveliness().declare_subscriber(
            RMW_SELECTOR.format(domain=ros.domain),
            zenoh.handlers.Callback(self._heard, indirect=False),
            history=True,
        )

    def close(self) -> None:
        """Watch no more. Safe to call twice."""
        self._subscriber.undeclare()

    def _heard(self, sample: zenoh.Sample) -> None:
        seen = parse_token(str(sample.key_expr))
        if not isinstance(seen, SeenEndpoint) or seen.role != "publisher" or seen.topic != self._topic:
            return
        if seen.node in self._own:
            return
        if sample.kind == zenoh.SampleKind.DELETE:
            self.others.discard(seen.node)
        elif seen.node not in self.others:
            self.others.add(seen.node)
            extra = lasting(lambda: seen.node in self.others)
            log.warning("%s publishes on %s as well: %s", seen.node, self._topic, _ADVICE, extra=extra)
