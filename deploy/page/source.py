"""The robots of a network as the source of a page: they are found, shown and commanded."""

from __future__ import annotations

import functools
import logging
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
from deploy.network_config import TopicsConfig
from deploy.page.feed import SILENT_SECONDS, RobotFeed, roles_of
from deploy.ros2 import Node
from deploy.ros2.graph import read_graph
from deploy.ros2.names import namespace, topic_name
from deploy.ros2.session import guest_of

log = logging.getLogger(__name__)

_LOOK_SECONDS: Final = 2.0
_ANSWER_SECONDS: Final = 5.0
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
        """Join the network of the configuration as a guest.

        Raises:
            RosError: an endpoint is malformed.
        """
        self._config = config
        self._node = Node(guest_of(config.ros), "hd_page")
        self._feeds: dict[str, RobotFeed] = {}
        # Before the first look: the own robot is to be seen at once.
        self._listen(_status_topic(config), config)
        self._looking = Ticker("looking for robots", _LOOK_SECONDS, self._look)

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
        session = self._node.session
        if command.verb == "stop":
            arguments = {"reason": str(command.arguments.get("reason", "by the page"))[:200]}
            answers = command_all(session, command.target or None, "stop", _ANSWER_SECONDS, arguments)
            wrong = [*answers.refusals]
            wrong += [f"robot {name!r} did not answer: it may still be moving" for name, _ in sorted(answers.missing)]
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
        self._looking.close()
        self._node.close()

    def _look(self) -> None:
        """Find robots that came."""
        suffix = "/" + self._config.topics.status.strip("/")
        for topic, endpoints in read_graph(self._node.session, self._config.ros.domain).topics().items():
            if topic in self._feeds or not topic.endswith(suffix):
                continue
            if not any(each.role == "publisher" and each.kind == "std_msgs/msg/String" for each in endpoints):
                continue
            if len(self._feeds) >= MAX_ROBOTS:
                log.warning("more than %d robots are on this network: %s is not shown", MAX_ROBOTS, topic)
                return
            self._listen(topic, below(self._config, topic.removesuffix(suffix)))

    def _listen(self, status: str, config: DeployConfig) -> None:
        feed = RobotFeed(config)
        for role, (topic, kind, qos) in roles_of(config).items():
            self._node.subscribe_raw(topic, kind, functools.partial(_take, feed, role), qos)
        self._feeds[status] = feed
        log.info("watching the robot whose status is on %s", status)


def below(config: DeployConfig, where: str) -> DeployConfig:
    """Return the configuration of a like robot all whose topics stand below a namespace."""
    names = {
        name: value.lstrip("/")
        for name, value in config.topics.model_dump().items()
        if isinstance(value, str) and name != "remap"
    }
    topics = TopicsConfig(**names)
    return config.model_copy(update={"topics": topics, "ros": config.ros.model_copy(update={"namespace": where})})


def _take(feed: RobotFeed, role: str, payload: bytes, received: object) -> None:
    del received
    feed.take(role, payload)


def _status_topic(config: DeployConfig) -> str:
    return topic_name(config.topics.status, namespace(config.ros.namespace), config.topics.remap)
