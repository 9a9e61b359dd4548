"""Which nodes and topics there are, read from the liveliness tokens of both layouts."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, field

import zenoh

from deploy.network_config import RosConfig
from deploy.ros2.keys import LETTERS, Role, ros_type
from deploy.ros2.qos import QoS
from deploy.ros2.session import open_session

ROLES: dict[str, Role] = {letters: role for role, letters in LETTERS.items()}
RMW_SELECTOR = "@ros2_lv/{domain}/**"
BRIDGE_SELECTOR = "@/*/@ros2_lv/**"


@dataclass(frozen=True, slots=True)
class SeenEndpoint:
    """A publisher or subscription that somebody announces.

    Attributes:
        role: publisher or subscription.
        topic: absolute name.
        kind: message type, such as `sensor_msgs/msg/LaserScan`.
        type_hash: hash of the type; empty where the token has none.
        qos: quality of service.
        node: full name of the node, or `bridge ZID` behind a zenoh-bridge-ros2dds.
    """

    role: Role
    topic: str
    kind: str
    type_hash: str
    qos: QoS
    node: str


@dataclass(frozen=True, slots=True)
class SeenNode:
    """A node that announces itself.

    Attributes:
        name: full name with its namespace.
        zid: Zenoh's identity of its session.
    """

    name: str
    zid: str


@dataclass(slots=True)
class Graph:
    """What is on the network.

    Attributes:
        nodes: in order of their names.
        endpoints: publishers and subscriptions, in order of their topics.
        elsewhere: other domains that have nodes, in ascending order.
    """

    nodes: list[SeenNode] = field(default_factory=list)
    endpoints: list[SeenEndpoint] = field(default_factory=list)
    elsewhere: list[int] = field(default_factory=list)

    def topics(self) -> dict[str, list[SeenEndpoint]]:
        """Return the endpoints of each topic."""
        topics: dict[str, list[SeenEndpoint]] = {}
        for endpoint in self.endpoints:
            topics.setdefault(endpoint.topic, []).append(endpoint)
        return topics


def parse_token(token: str) -> SeenNode | SeenEndpoint | None:
    """Read a liveliness token of either layout; None for services, actions and anything that is no such token."""
    parts = token.split("/")
    if parts[0] == "@ros2_lv" and len(parts) >= 9:
        return _parse_rmw(parts)
    if parts[0] == "@" and len(parts) == 7 and parts[2] == "@ros2_lv" and parts[3] in ROLES:
        _, zid, _, letters, key, kind, qos = parts
        pieces = qos.split(":")
        return SeenEndpoint(
            ROLES[letters],
            "/" + key.replace("§", "/"),
            kind.replace("§", "/"),
            pieces[4].removeprefix("typehash=").removesuffix(";") if len(pieces) > 4 else "",
            _parse_bridge_qos(pieces),
            f"bridge {zid}",
        )
    return None


def read_graph(session: zenoh.Session, domain: int, timeout: float = 1.0) -> Graph:
    """Ask the network for its tokens.

    Args:
        session: connected already.
        domain: ROS_DOMAIN_ID whose nodes are listed; of the others only that there are some. Bridges are listed
            whatever their domain.
        timeout: how long to wait for answers, seconds.
    """
    tokens: list[str] = []
    domains: set[int] = set()
    for selector in (RMW_SELECTOR.format(domain="*"), BRIDGE_SELECTOR):
        for reply in session.liveliness().get(selector, timeout=timeout):
            if reply.ok is None:
                continue
            token = str(reply.ok.key_expr)
            found = _domain(token)
            if found is None or found == domain:
                tokens.append(token)
            else:
                domains.add(found)
    graph = graph_from(tokens)
    graph.elsewhere = sorted(domains)
    return graph


def watch(config: RosConfig, wait: float = 1.0) -> Graph:
    """Join the network as an onlooker, wait for its gossip, and list its nodes and topics.

    Args:
        config: endpoints and domain.
        wait: seconds until the list is made.

    Raises:
        RosError: when an endpoint is malformed or taken.
    """
    with open_session(config) as session:
        time.sleep(wait)
        return read_graph(session, config.domain)


def graph_from(tokens: Iterable[str]) -> Graph:
    """Sort tokens into nodes and endpoints; what is neither is left out."""
    graph = Graph()
    for token in set(tokens):
        seen = parse_token(token)
        if isinstance(seen, SeenNode):
            graph.nodes.append(seen)
        elif seen is not None:
            graph.endpoints.append(seen)
    graph.nodes.sort(key=lambda node: (node.name, node.zid))
    graph.endpoints.sort(key=lambda endpoint: (endpoint.topic, endpoint.role, endpoint.node))
    return graph


def _domain(token: str) -> int | None:
    """Return the domain of a token of rmw_zenoh; None for others."""
    prefix, _, rest = token.partition("/")
    number = rest.partition("/")[0]
    return int(number) if prefix == "@ros2_lv" and number.isascii() and number.isdecimal() else None


def _parse_rmw(parts: list[str]) -> SeenNode | SeenEndpoint | None:
    zid, letters = parts[2], parts[5]
    name = parts[7].replace("%", "/").rstrip("/") + "/" + parts[8]
    if letters == "NN":
        return SeenNode(name, zid)
    if letters not in ROLES or len(parts) < 13:
        return None
    topic, kind, hash_, qos = parts[9], parts[10], parts[11], parts[12]
    return SeenEndpoint(
        ROLES[letters], topic.replace("%", "/"), ros_type(kind), hash_, _parse_rmw_qos(qos), name
    )  # fmt: skip


def _parse_rmw_qos(text: str) -> QoS:
    reliability, durability, history, *_ = [*text.split(":"), "", "", ""]
    return QoS(reliability != "2", durability == "1", _depth(history, 42))


def _parse_bridge_qos(pieces: list[str]) -> QoS:
    _, reliability, durability, history, *_ = [*pieces, "", "", "", ""]
    return QoS(reliability != "0", durability == "1", _depth(history, 1))


def _depth(history: str, default: int) -> int:
    text = history.partition(",")[2]
    return max(int(text), 1) if text.isascii() and text.isdigit() else default
