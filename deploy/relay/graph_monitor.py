"""Looks at who else is on the robot's topics, and says what cannot work."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Final

from deploy.relay.dds import DdsNode, Peer
from deploy.relay.lanes import Lane
from deploy.ros2.messages import type_hash
from deploy.routes import Direction, Route, mismatch

log = logging.getLogger(__name__)

# Nodes that start together with the relay need a moment.
_PATIENCE: Final = 5.0
# Topics that a message names at most.
_SHOWN: Final = 6


class GraphMonitor:
    """Finds wrong types, other sources of velocities, other nodes of the relay's name, and needed topics that lack.

    Attributes:
        problems: of this moment, each one sentence; each is logged once, when it appears.
    """

    def __init__(self, dds: DdsNode, lanes: Sequence[Lane], distro: str, domain: int) -> None:
        self._dds = dds
        self._domain = domain
        self._lanes = lanes
        self._distro = distro
        self.problems: list[str] = []

    def look(self, age: float) -> None:
        """Look once.

        Args:
            age: seconds since the relay began.
        """
        found: list[str] = []
        if self._dds.namesakes() > 0:
            found.append(f"another node in DDS has the name {self._dds.full_name}: is it a second relay? Stop one")
        alone = age > _PATIENCE and self._dds.alone()
        if alone:
            found.append(
                f"no other node in DDS domain {self._domain}: is the robot in another one (its ROS_DOMAIN_ID; set "
                "ros.domain), or do ROS_AUTOMATIC_DISCOVERY_RANGE or ROS_LOCALHOST_ONLY keep it on its own machine?"
            )
        for lane in self._lanes if not alone else ():
            found += self._of_route(lane.route, lane.messages, age)
        for problem in found:
            if problem not in self.problems:
                log.warning("%s", problem)
        self.problems = found

    def _of_route(self, route: Route, messages: int, age: float) -> list[str]:
        inwards = route.direction is Direction.TO_BRIDGE
        publishers = self._dds.publishers_of(route.topic)
        peers = publishers if inwards else self._dds.subscriptions_to(route.topic)
        found = [self._of_type(route, peer) for peer in peers]
        if route.alone:
            found += [
                f"{peer.node} publishes on {route.topic} as well: what it sends reaches the wheels past the watchdog, "
                "in an emergency too: stop it, or put a multiplexer in between"
                for peer in publishers
            ]
        if not inwards:
            found += [
                f"{peer.node} receives nothing on {route.topic}, because its subscription asks for {peer.promise}, "
                "which the relay does not promise: leave that out of its QoS"
                for peer in peers
                if peer.promise
            ]
        # A map that was latched is kept, and may have been published only once.
        kept = messages and route.qos.transient_local
        if route.needed and not publishers and not kept and age > _PATIENCE:
            found.append(self._lacking(route, messages))
        return [problem for problem in found if problem]

    def _lacking(self, route: Route, messages: int) -> str:
        """Say that nobody publishes what the bridge needs, and where the same is published instead."""
        if messages:
            return f"{route.topic} has lost its publisher in DDS, and the bridge needs it: start its driver again"
        others = [
            topic
            for topic, kinds in self._dds.published().items()
            # Of one type, but no replacement for each other: /tf and /tf_static.
            if route.kind in kinds and topic.endswith("_static") == route.topic.endswith("_static")
        ]
        what = f"no publisher in DDS for {route.topic} ({route.kind}), which the bridge needs"
        if not others:
            return what
        shown = ", ".join(others[:_SHOWN]) + (f" and {len(others) - _SHOWN} more" if len(others) > _SHOWN else "")
        return f"{what}, but for {shown}: set {route.setting}={others[0]} for relay and bridge"

    def _of_type(self, route: Route, peer: Peer) -> str:
        ours = type_hash(route.kind, self._distro)
        # Humble's types have no hash, which keeps nobody in DDS from hearing them.
        return mismatch(route, peer.node, peer.kind, peer.type_hash, ours if ours.startswith("RIHS") else "")
