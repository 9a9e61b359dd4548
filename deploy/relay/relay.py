"""The relay: one node in DDS, one in Zenoh, and bytes between them."""

from __future__ import annotations

import functools
import logging
import threading
import time
from contextlib import ExitStack
from typing import Any, Final

from common.bus.control import ControlServer, request
from common.errors import BusError
from common.system.closing import Closing
from deploy.config import DeployConfig
from deploy.relay.dds import DdsNode, domain_of
from deploy.relay.graph_monitor import GraphMonitor
from deploy.relay.lanes import Lane, ToBridge, ToRobot
from deploy.relay.names import node_name, relay_name
from deploy.relay.standstill import Standstill
from deploy.ros2 import Node, RosError
from deploy.ros2.definitions import SERVICES, service_name
from deploy.ros2.names import namespace, topic_name
from deploy.routes import Direction, routes_of

log = logging.getLogger(__name__)

_TICK: Final = 0.05
_LOOK: Final = 1.0
_COUNTERS: Final = 10.0
DISCOVERY_SECONDS: Final = 3.0
"""DDS nodes find each other at once, or, where the first announcement was lost, within 2.5 s as measured."""
# A transition may take its time; whoever only asks should not.
_SERVICE_SECONDS: Final = 3.0


class Relay(Closing):
    """Carries the topics and services of a robot's profile between DDS and Zenoh.

    In DDS it stands for the bridge, under the name of the bridge's node: that is whom `ros2 node list` shows.

    Usage::

        with Relay(config) as relay:
            relay.run(stop)
    """

    def __init__(self, config: DeployConfig) -> None:
        """Join both networks.

        Args:
            config: of the robot; with `ros.listen` the relay is the router of the Zenoh network.

        Raises:
            RosError: rclpy is missing, a name or an endpoint cannot be used, or another relay is at work.
        """
        ros = config.ros
        self._config = config
        self._began = time.monotonic()
        routes = routes_of(config)
        domain = domain_of(ros.domain, given="domain" in ros.model_fields_set)
        self._parts = ExitStack()
        enter = self._parts.enter_context
        try:
            self._dds = enter(DdsNode(ros.node, namespace(ros.namespace), domain=domain, distro=ros.distro))
            self._check_alone_in_dds(domain)
            # Absolute names, remapped already.
            self._node = enter(Node(ros.model_copy(update={"node": node_name(ros)})))
            self._check_alone_in_zenoh()
            self._to_robot = [
                ToRobot(route, self._dds, self._node) for route in routes if route.direction is Direction.TO_ROBOT
            ]
            self._standstill = self._watched_over()
            for lane in self._to_robot:
                lane.follow()
            self._to_bridge = [
                ToBridge(route, self._dds, self._node) for route in routes if route.direction is Direction.TO_BRIDGE
            ]
            self._services = self._offer_services()
            self._monitor = GraphMonitor(self._dds, self._lanes, ros.distro, domain)
            name = relay_name(config.name)
            enter(ControlServer(self._node.session, name, lambda _: self.status(), ("status",)))
        except BaseException:
            self._parts.close()
            raise
        self.domain = domain

    @property
    def _lanes(self) -> list[Lane]:
        return [*self._to_bridge, *self._to_robot]

    def run(self, stop: threading.Event) -> None:
        """Carry messages until `stop` is set."""
        next_look = self._began
        next_counters = self._began + _COUNTERS
        while not stop.wait(_TICK):
            now = time.monotonic()
            self._standstill.tick(now)
            for inwards in self._to_bridge:
                inwards.adapt()
            if now >= next_look:
                next_look = now + _LOOK
                for lane in self._to_robot:
                    lane.follow()
                self._monitor.look(now - self._began)
            if now >= next_counters:
                next_counters = now + _COUNTERS
                log.info("%s", self.counters())

    def counters(self) -> str:
        """Return one line: messages of both directions, and topics from which nothing came."""
        status = self.status()
        inwards = ", ".join(
            f"{topic} {each['messages']}" for topic, each in status["to_bridge"].items() if each["messages"]
        )
        outwards = status["to_robot"]
        silent = [lane.route.topic for lane in self._to_bridge if lane.route.needed and not lane.messages]
        sent, lost = sum(each["messages"] for each in outwards.values()), status["lost"]
        line = f"to the bridge: {inwards or 'nothing'}; to the robot: {sent} on {len(outwards)} topics; lost {lost}"
        return f"{line}; no message from {', '.join(silent)}" if silent else line

    def status(self) -> dict[str, Any]:
        """Return all counters, ready for JSON."""
        now = time.monotonic()
        return {
            "name": self._config.name,
            "dds_node": self._dds.full_name,
            "dds_domain": self.domain,
            "uptime": round(now - self._began, 1),
            "stopping": self._standstill.stopping,
            "services": self._services,
            "lost": sum(lane.lost for lane in self._lanes),
            "problems": self._monitor.problems,
            "published_in_dds": self._dds.published(),
            "to_bridge": {lane.route.topic: lane.status(now) for lane in self._to_bridge},
            "to_robot": {lane.route.topic: lane.status(now) for lane in self._to_robot},
        }

    def close(self) -> None:
        """Stop a robot under way and leave both networks. Safe to call twice."""
        self._standstill.leave()
        self._parts.close()

    def _watched_over(self) -> Standstill:
        topics = self._config.topics

        def lane_of(topic: str) -> ToRobot | None:
            full = self._absolute(topic)
            return next((lane for lane in self._to_robot if topic and lane.route.topic == full), None)

        velocity, stop, watchdog = (lane_of(topic) for topic in (topics.velocity, topics.stop, topics.watchdog))
        standstill = Standstill(
            self._config.safety,
            self._config.driving.message,
            self._config.ros.distro,
            velocity.send if velocity else None,
            stop.send if stop else None,
        )
        if velocity is not None:
            velocity.tell = lambda payload: standstill.heard_velocity(payload, time.monotonic())
        if stop is not None:
            stop.tell = standstill.heard_stop
        if watchdog is not None:
            watchdog.tell = lambda payload: standstill.heard_watchdog(payload, time.monotonic())
        return standstill

    def _absolute(self, topic: str) -> str:
        return topic_name(topic, self._node.namespace, self._config.topics.remap) if topic else ""

    def _offer_services(self) -> list[str]:
        offered, lacking = [], set()
        for kind in SERVICES:
            name = f"{self._dds.full_name}/{service_name(kind)}"
            client = self._node.client(name, kind)
            if self._dds.service(name, kind, functools.partial(client.call_raw, timeout=_SERVICE_SECONDS)):
                offered.append(name)
            else:
                lacking.add(kind.split("/", 1)[0])
        if lacking:
            log.warning("the lifecycle's services are not relayed: install the ROS 2 package %s", ", ".join(lacking))
        return offered

    def _check_alone_in_dds(self, domain: int) -> None:
        until = time.monotonic() + DISCOVERY_SECONDS
        while time.monotonic() < until:
            if self._dds.namesakes():
                raise RosError(
                    f"DDS domain {domain} already has a node {self._dds.full_name}, another relay or bridge: stop "
                    "it, or give this robot another namespace or node name (ros.namespace, ros.node)"
                )
            time.sleep(0.05)

    def _check_alone_in_zenoh(self) -> None:
        if self._config.ros.listen:
            return
        try:
            request(self._node.session, relay_name(self._config.name), "status", 0.7)
        except BusError:
            return
        raise RosError(
            f"a relay for robot {self._config.name!r} is already running on this Zenoh network: stop it, or give "
            "this one another name with --name or ros.namespace"
        )
