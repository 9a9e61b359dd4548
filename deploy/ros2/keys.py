"""How a ROS 2 topic becomes Zenoh keys, tokens and attachments, in the two layouts there are.

`rmw_zenoh` is the middleware of robots whose RMW is Zenoh; `ros2dds` is the layout behind a zenoh-bridge-ros2dds, which
carries the topics of a robot whose RMW is DDS.
"""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Literal

import xxhash

from deploy.ros2.messages import type_hash
from deploy.ros2.qos import QoS

Role = Literal["publisher", "subscription"]
LETTERS: dict[Role, str] = {"publisher": "MP", "subscription": "MS"}

ATTACHMENT = struct.Struct("<qqB16s")
GID_SIZE = 16
RMW_DEFAULT_DEPTH = 42


@dataclass(frozen=True, slots=True)
class Attachment:
    """What rmw_zenoh sends beside every message; its nodes refuse messages without it.

    Attributes:
        sequence: number of the message of its publisher.
        time: when it was published, nanoseconds since 1970.
        gid: the publisher, 16 bytes.
    """

    sequence: int
    time: int
    gid: bytes

    def pack(self) -> bytes:
        """Return the 33 bytes: sequence and time as int64, the length of the gid, the gid."""
        return ATTACHMENT.pack(self.sequence, self.time, GID_SIZE, self.gid)

    @classmethod
    def unpack(cls, payload: bytes) -> Attachment | None:
        """Read an attachment; None when the bytes are none."""
        if len(payload) != ATTACHMENT.size:
            return None
        sequence, time, size, gid = ATTACHMENT.unpack(payload)
        return cls(sequence, time, gid) if size == GID_SIZE else None


@dataclass(frozen=True, slots=True)
class NodeId:
    """Which node a token speaks of.

    Attributes:
        domain: ROS_DOMAIN_ID.
        zid: Zenoh's identity of the session.
        number: number of the node within its session.
        namespace: in full, such as `/` or `/robot1`.
        name: such as `hd_bridge`.
    """

    domain: int
    zid: str
    number: int
    namespace: str
    name: str


class Layout(ABC):
    """One way to lay ROS 2 out on Zenoh."""

    @abstractmethod
    def topic_key(self, topic: str, kind: str) -> str:
        """Return the key on which the messages of a topic, or the requests of a service, go."""

    @abstractmethod
    def node_token(self, node: NodeId) -> str | None:
        """Return the liveliness token of a node; None where a node has none."""

    @abstractmethod
    def endpoint_token(self, role: Role, topic: str, kind: str, qos: QoS, node: NodeId, number: int) -> str:
        """Return the liveliness token of a publisher or subscription; `number` is unique in its session."""

    @abstractmethod
    def service_token(self, name: str, kind: str, node: NodeId, number: int, *, server: bool) -> str:
        """Return the liveliness token of a service's server, or of a client of it."""

    @abstractmethod
    def gid(self, token: str) -> bytes | None:
        """Return the identity that goes into attachments; None where messages have none."""


@dataclass(frozen=True, slots=True)
class RmwZenoh(Layout):
    """Keys of rmw_zenoh: `<domain>/<topic>/<type>/<hash>`, tokens below `@ros2_lv`.

    Attributes:
        domain: ROS_DOMAIN_ID.
        distro: distribution, for the type hashes.
    """

    domain: int
    distro: str

    def topic_key(self, topic: str, kind: str) -> str:
        """Return domain, topic, mangled type and type hash."""
        return f"{self.domain}{topic}/{dds_type(kind)}/{type_hash(kind, self.distro)}"

    def node_token(self, node: NodeId) -> str:
        """Return the token by which `ros2 node list` finds the node."""
        return f"{self._prefix(node, node.number)}/NN/{_node_path(node)}"

    def endpoint_token(self, role: Role, topic: str, kind: str, qos: QoS, node: NodeId, number: int) -> str:
        """Return the token by which `ros2 topic list` finds the topic."""
        return "/".join((
            self._prefix(node, number),
            LETTERS[role],
            _node_path(node),
            topic.replace("/", "%"),
            dds_type(kind),
            type_hash(kind, self.distro),
            rmw_qos(qos),
        ))  # fmt: skip

    def service_token(self, name: str, kind: str, node: NodeId, number: int, *, server: bool) -> str:
        """Return the token by which `ros2 service list` finds the service."""
        return "/".join((
            self._prefix(node, number),
            "SS" if server else "SC",
            _node_path(node),
            name.replace("/", "%"),
            dds_type(kind),
            type_hash(kind, self.distro),
            rmw_qos(QoS(depth=10)),
        ))  # fmt: skip

    def gid(self, token: str) -> bytes:
        """Return the 128-bit XXH3 hash of the token, low half first."""
        return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(GID_SIZE, "little")

    def _prefix(self, node: NodeId, number: int) -> str:
        return f"@ros2_lv/{node.domain}/{node.zid}/{node.number}/{number}"


@dataclass(frozen=True, slots=True)
class Ros2dds(Layout):
    """Keys of zenoh-bridge-ros2dds: the topic's name alone; tokens below `@/<zid>/@ros2_lv`.

    Attributes:
        distro: distribution, for the type hashes in tokens.
    """

    distro: str

    def topic_key(self, topic: str, kind: str) -> str:
        """Return the topic's name without its leading slash."""
        del kind
        return topic.removeprefix("/")

    def node_token(self, node: NodeId) -> None:
        """Return nothing: bridges tell of topics alone."""
        del node

    def endpoint_token(self, role: Role, topic: str, kind: str, qos: QoS, node: NodeId, number: int) -> str:
        """Return the token by which bridges make the topic known in their DDS networks."""
        del number
        key = self.topic_key(topic, kind).replace("/", "§")
        return (
            f"@/{node.zid}/@ros2_lv/{LETTERS[role]}/{key}/{kind.replace('/', '§')}/{bridge_qos(qos, kind, self.distro)}"
        )

    def service_token(self, name: str, kind: str, node: NodeId, number: int, *, server: bool) -> str:
        """Return the token by which bridges make the service known in their DDS networks."""
        del number
        key = self.topic_key(name, kind).replace("/", "§")
        return f"@/{node.zid}/@ros2_lv/{'SS' if server else 'SC'}/{key}/{kind.replace('/', '§')}"

    def gid(self, token: str) -> None:
        """Return nothing: messages have no attachment."""
        del token


def _node_path(node: NodeId) -> str:
    # The first % stands for the enclave of SROS, which nobody has here.
    return f"%/{node.namespace.replace('/', '%')}/{node.name}"


def layout_of(name: str, domain: int, distro: str) -> Layout:
    """Return the layout of a name in the configuration: `rmw_zenoh` or `ros2dds`."""
    return RmwZenoh(domain, distro) if name == "rmw_zenoh" else Ros2dds(distro)


def dds_type(kind: str) -> str:
    """Return a type as DDS mangles it: `std_msgs/msg/String` becomes `std_msgs::msg::dds_::String_`."""
    package, folder, name = kind.split("/")
    return f"{package}::{folder}::dds_::{name}_"


def ros_type(mangled: str) -> str:
    """Return the ROS name of a mangled type; text that is none comes back as it is."""
    package, middle, name = mangled.partition("::dds_::")
    return f"{package.replace('::', '/')}/{name.removesuffix('_')}" if middle else mangled


def rmw_qos(qos: QoS) -> str:
    """Return a QoS as rmw_zenoh's tokens hold it; what equals the RMW's default is empty."""
    reliability = "" if qos.reliable else "2"
    durability = "1" if qos.transient_local else ""
    depth = "" if qos.depth == RMW_DEFAULT_DEPTH else str(qos.depth)
    return f"{reliability}:{durability}:,{depth}:,:,:,,"


def bridge_qos(qos: QoS, kind: str, distro: str) -> str:
    """Return a QoS as the tokens of zenoh-bridge-ros2dds hold it: keyless, reliability, durability, history, hash."""
    text = f":{int(qos.reliable)}:{int(qos.transient_local)}:0,{qos.depth}"
    # The type's hash travels in DDS user data, which humble does not have.
    return text if distro == "humble" else f"{text}:typehash={type_hash(kind, distro)};"
