"""The robots of a network as the source of a page: they are found, shown and commanded."""

from __future__ import annotations

import functools
import logging
import threading
from collections.abc import Mapping
from typing import Any, Final

from common.bus.control import request
from common.bus.fleet import command_all
from common.errors import BusError
from common.messages.replies import ROBOT_VERBS
from common.page.hub import Hub
from common.page.source import Command, Source
from common.system.threads import Ticker
from deploy.bridge.command_text import CommandError
from deploy.config import DeployConfig
from deploy.network_config import TopicsConfig, guest_of
from deploy.page.feed import SILENT_SECONDS, RobotFeed, roles_of
from deploy.ros2 import Node, RosError
from deploy.ros2.graph import read_graph
from deploy.ros2.names import namespace, topic_name

log = logging.getLogger(__name__)

_LOOK_SECONDS: Final = 2.0
_ANSWER_SECONDS: Final = 5.0
_JOIN_SECONDS: Final = 1.0
MAX_ROBOTS: Final = 32
"""Robots on one page."""


class Robots(Source):
    """Every robot of a network whose bridge tells its status, and its commands.

    The robot of the configuration is listened to at once. Others are found by their status topics: one below a
    namespace, such as ``/robot2/hd/status``, is taken for a robot whose topics all stand there.
    """

    verbs = ROBOT_VERBS
    urgent = ("stop",)

    def __init__(self, config: DeployConfig) -> None:
        """Join the network of the configuration as a guest; where its router is not there yet, as soon as it is.

        Raises:
            RosError: an endpoint is malformed.
        """
        self._config = config
        self._feeds: dict[str, RobotFeed] = {}
        self._node: Node | None = None
        self._problem: RosError | None = None
        self._looking: Ticker | None = None
        self._closed = False
        # A bridge that is the router itself starts its page before itself.
        joining = threading.Thread(target=self._join, name="joining the network", daemon=True)
        joining.start()
        joining.join(_JOIN_SECONDS)
        if self._problem is not None:
            raise self._problem

    def refresh(self, hub: Hub) -> None:
        """Put what all robots told since the last time."""
        for feed in list(self._feeds.values()):
            feed.refresh(hub)
        known = [feed for feed in self._feeds.values() if feed.name]
        hub.put("robots", [{"name": feed.name, "silent": feed.age > SILENT_SECONDS} for feed in known])

    def carry_out(self, command: Command) -> Mapping[str, Any]:
        """Pass a command on to a bridge; a stop without a target goes to every robot, and fails unless each obeys.

        Raises:
            BusError: a robot did not answer, or refused.
            CommandError: no robot is named.
        """
        if self._node is None:
            raise BusError(f"the robots' router is not there yet ({', '.join(guest_of(self._config.ros).connect)})")
        session = self._node.session
        if command.verb == "stop":
            arguments = {"reason": str(command.arguments.get("reason", "by the page"))[:200]}
            answers = command_all(session, command.target or None, "stop", _ANSWER_SECONDS, arguments)
            wrong = answers.problems(_ANSWER_SECONDS)
            if not answers.states and not wrong:
                wrong.append(f"no robot answered within {_ANSWER_SECONDS:g} s: use the robot's own stop")
            if wrong:
                raise BusError("; ".join(wrong))
            return {name: state for (name, _), state in answers.states.items()}
        if not command.target:
            raise CommandError(f"{command.verb!r} is for one robot: name it as the target")
        return request(session, command.target, command.verb, _ANSWER_SECONDS, command.arguments, asked="robot")

    def close(self) -> None:
        """Leave the network; safe to call twice."""
        self._closed = True
        if self._looking is not None:
            self._looking.close()
        if self._node is not None:
            self._node.close()

    def _join(self) -> None:
        """Join the network, however long its router takes, and begin to look for robots."""
        try:
            node = Node(guest_of(self._config.ros), "hd_page")
        except RosError as error:
            self._problem = error
            log.error("no robots can be shown: %s", error)
            return
        if self._closed:
            node.close()
            return
        # The own robot is to be seen at once, before the first look.
        self._listen(node, _status_topic(self._config), self._config)
        self._node = node
        self._looking = Ticker("looking for robots", _LOOK_SECONDS, lambda: self._look(node))

    def _look(self, node: Node) -> None:
        """Find robots that came."""
        suffix = "/" + self._config.topics.status.strip("/")
        for topic, endpoints in read_graph(node.session, self._config.ros.domain).topics().items():
            if topic in self._feeds or not topic.endswith(suffix):
                continue
            if not any(each.role == "publisher" and each.kind == "std_msgs/msg/String" for each in endpoints):
                continue
            if len(self._feeds) >= MAX_ROBOTS:
                log.warning("more than %d robots are on this network: %s is not shown", MAX_ROBOTS, topic)
                return
            self._listen(node, topic, below(self._config, topic.removesuffix(suffix)))

    def _listen(self, node: Node, status: str, config: DeployConfig) -> None:
        feed = RobotFeed(config)
        for role, (topic, kind, qos) in roles_of(config).items():
            node.subscribe_raw(topic, kind, functools.partial(_take, feed, role), qos)
        self._feeds[status] = feed
        log.info("watching the robot whose status is on %s", status)


def below(config: DeployConfig, where: str) -> DeployConfig:
    """Return the configuration of a like robot all whose topics stand below a namespace."""
    names = {
        name: value.lstrip("/")
        for name, value in config.topics.model_dump().items()
        if isinstance(value, str) and name != "remap"
    }
    topics = TopicsConfig.model_validate(names)
    return config.model_copy(update={"topics": topics, "ros": config.ros.model_copy(update={"namespace": where})})


def _take(feed: RobotFeed, role: str, payload: bytes, received: object) -> None:
    del received
    feed.take(role, payload)


def _status_topic(config: DeployConfig) -> str:
    return topic_name(config.topics.status, namespace(config.ros.namespace), config.topics.remap)
