"""Who speaks another type on a topic of the bridge: over Zenoh nothing goes between the two, and nobody is told."""

from __future__ import annotations

import logging
from typing import Final

import zenoh

from common.system.closing import Closing
from common.system.logs import lasting
from deploy.config import DeployConfig
from deploy.ros2.graph import BRIDGE_SELECTOR, RMW_SELECTOR, SeenEndpoint, parse_token
from deploy.ros2.messages import type_hash
from deploy.routes import Direction, Route, mismatch, named_routes

log = logging.getLogger(__name__)

# Tokens come from outside: of more mismatches than a robot can have none is told.
_MOST: Final = 100
_MAP: Final = "nav_msgs/msg/OccupancyGrid"
# By custom on the topic of the map with `_updates` behind it.
_UPDATE: Final = "map_msgs/msg/OccupancyGridUpdate"


class TypeWatch(Closing):
    """Warns of every node that publishes what the bridge hears, or hears what it publishes, in a way that does not fit.

    Attributes:
        problems: what does not fit at this moment, each one sentence with its remedy.
    """

    def __init__(self, session: zenoh.Session, config: DeployConfig) -> None:
        """Watch the liveliness tokens of the robot's network.

        Raises:
            RosError: a topic's name is malformed.
        """
        self._config = config
        self._routes = named_routes(config)
        self.problems: dict[str, str] = {}
        in_rmw = config.ros.layout == "rmw_zenoh"
        self._subscriber = session.liveliness().declare_subscriber(
            RMW_SELECTOR.format(domain=config.ros.domain) if in_rmw else BRIDGE_SELECTOR,
            zenoh.handlers.Callback(self._heard, indirect=False),
            history=True,
        )

    def close(self) -> None:
        """Watch no more. Safe to call twice."""
        self._subscriber.undeclare()

    def _heard(self, sample: zenoh.Sample) -> None:
        token = str(sample.key_expr)
        if sample.kind == zenoh.SampleKind.DELETE:
            self.problems.pop(token, None)
            return
        seen = parse_token(token)
        problem = type_problem(self._config, self._routes, seen) if isinstance(seen, SeenEndpoint) else ""
        if problem and token not in self.problems and len(self.problems) < _MOST:
            self.problems[token] = problem
            log.warning("%s", problem, extra=lasting(lambda: token in self.problems))


def type_problem(config: DeployConfig, routes: list[Route], seen: SeenEndpoint) -> str:
    """Say why nothing goes between the bridge and an endpoint of another node; empty where it does.

    Args:
        config: of the robot.
        routes: as of `named_routes`.
        seen: what a node announces.
    """
    if seen.role == "publisher" and seen.kind == _UPDATE:
        return _partial_map(routes, seen)
    asked = Direction.TO_BRIDGE if seen.role == "publisher" else Direction.TO_ROBOT
    wanted = [route for route in routes if route.topic == seen.topic and route.direction is asked]
    if not wanted:
        return ""
    route = next((each for each in wanted if each.kind == seen.kind), wanted[0])
    # Behind a zenoh-bridge-ros2dds keys hold no type: a hash keeps nobody from hearing.
    ours = type_hash(route.kind, config.ros.distro) if config.ros.layout == "rmw_zenoh" else ""
    return mismatch(route, seen.node, seen.kind, seen.type_hash, ours)


def _partial_map(routes: list[Route], seen: SeenEndpoint) -> str:
    """Say that a node may send a part of the map where the bridge waits for all of it; empty for other maps."""
    maps = [route.topic for route in routes if route.kind == _MAP and route.direction is Direction.TO_BRIDGE]
    for topic in maps:
        if seen.topic == f"{topic}_updates":
            return (
                f"{seen.node} publishes changes of {topic} on {seen.topic}, which the bridge does not hear: let it "
                "publish whole maps (nav2's costmaps: always_send_full_costmap: true), or set topics.map to the SLAM's"
            )
    return ""
