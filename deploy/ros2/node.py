"""A ROS 2 node on Zenoh, without ROS."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from typing import Any

import zenoh

from common.system.closing import Closing
from deploy.network_config import RosConfig
from deploy.ros2.dispatch import Dispatcher
from deploy.ros2.endpoints import Endpoint, Latest, Publisher, Received, Subscription
from deploy.ros2.keys import NodeId, Role, layout_of
from deploy.ros2.messages import Message, check_kind
from deploy.ros2.names import namespace, topic_name
from deploy.ros2.qos import RELIABLE, QoS
from deploy.ros2.services import Client, Service, ServiceEndpoint
from deploy.ros2.session import open_session


class Node(Closing):
    """A ROS 2 node: one Zenoh session, one thread for all callbacks; it can be made before any router is there.

    Usage::

        with Node(RosConfig()) as node:
            velocity = node.publisher("/cmd_vel", "geometry_msgs/msg/Twist")
            scan = node.latest("/scan", "sensor_msgs/msg/LaserScan", SENSOR)
            velocity.publish(twist(0.5, 0.0))

    Attributes:
        name: of the node.
        namespace: in full.
        distro: distribution whose definitions are spoken.
        session: Zenoh's session, for what is no ROS topic.
    """

    def __init__(self, config: RosConfig, name: str | None = None, remap: Mapping[str, str] | None = None) -> None:
        """Join the network.

        Args:
            config: layout, distribution, domain, namespace and endpoints.
            name: of the node; `config.node` when not given.
            remap: topic names replaced by others.

        Raises:
            RosError: when a name or an endpoint is malformed, or an endpoint to listen on is taken.
        """
        self.name = name or config.node
        self.distro = config.distro
        self.namespace = namespace(config.namespace)
        self._config = config
        self._remap = dict(remap or {})
        self._layout = layout_of(config.layout, config.domain, config.distro)
        self._numbers = itertools.count()
        self._endpoints: list[Publisher | Subscription] = []
        self._services: list[Service] = []
        self._closed = False
        topic_name(self.name)
        self.session = open_session(config)
        self._dispatcher = Dispatcher(f"ros2-{self.name}")
        self._id = NodeId(config.domain, str(self.session.zid()), next(self._numbers), self.namespace, self.name)
        token = self._layout.node_token(self._id)
        self._token: zenoh.LivelinessToken | None = None
        if token is not None:
            self._token = self.session.liveliness().declare_token(token)

    def publisher(self, topic: str, kind: str, qos: QoS = RELIABLE) -> Publisher:
        """Declare a publisher.

        Args:
            topic: absolute, or relative to the node's namespace.
            kind: message type, such as `geometry_msgs/msg/Twist`.
            qos: quality of service; LATCHED gives late subscribers the last message.

        Raises:
            RosError: for a malformed name or an unknown type.
        """
        publisher = Publisher(self.session, self._endpoint("publisher", topic, kind, qos))
        self._endpoints.append(publisher)
        return publisher

    def subscribe(
        self, topic: str, kind: str, callback: Callable[[Any, Received], None], qos: QoS = RELIABLE
    ) -> Subscription:
        """Call `callback(message, received)` in the node's thread for every message; it must not block.

        Raises:
            RosError: for a malformed name or an unknown type.
        """
        return self._subscribe(topic, kind, callback, qos, raw=False)

    def subscribe_raw(
        self, topic: str, kind: str, callback: Callable[[bytes, Received], None], qos: QoS = RELIABLE
    ) -> Subscription:
        """Call `callback(payload, received)` with the CDR of every message, as it came.

        Raises:
            RosError: for a malformed name or an unknown type.
        """
        return self._subscribe(topic, kind, callback, qos, raw=True)

    def latest(self, topic: str, kind: str, qos: QoS = RELIABLE) -> Latest:
        """Keep the newest message of a topic.

        Raises:
            RosError: for a malformed name or an unknown type.
        """
        return Latest(lambda callback: self._subscribe(topic, kind, callback, qos, raw=False))

    def service(self, name: str, kind: str, handle: Callable[[Message], Message], threads: int = 1) -> Service:
        """Offer a service; `handle(request)` makes the response, in threads of the service's own.

        Args:
            name: absolute, relative to the node's namespace, or below the node itself, such as `~/get_state`.
            kind: such as `lifecycle_msgs/srv/GetState`.
            handle: its HDErrors are the answer to the asker.
            threads: that answer, where a response may take its time.

        Raises:
            RosError: for a malformed name or an unknown type.
        """
        service = Service(self.session, self._service_endpoint(name, kind, server=True), handle, threads)
        self._services.append(service)
        return service

    def client(self, name: str, kind: str) -> Client:
        """Return what calls a service; see `service`.

        Raises:
            RosError: for a malformed name or an unknown type.
        """
        return Client(self.session, self._service_endpoint(name, kind, server=False))

    def resolve(self, topic: str) -> str:
        """Return the absolute, remapped name of a topic or service."""
        if topic.startswith("~/"):
            topic = f"{self.namespace.rstrip('/')}/{self.name}/{topic.removeprefix('~/')}"
        return topic_name(topic, self.namespace, self._remap)

    def close(self) -> None:
        """Withdraw everything and leave the network."""
        if self._closed:
            return
        self._closed = True
        for service in self._services:
            service.close()
        self.session.close()
        self._dispatcher.close()

    def _subscribe(
        self, topic: str, kind: str, callback: Callable[[Any, Received], None], qos: QoS, *, raw: bool
    ) -> Subscription:
        endpoint = self._endpoint("subscription", topic, kind, qos)
        subscription = Subscription(self.session, endpoint, self._dispatcher, callback, raw=raw)
        self._endpoints.append(subscription)
        return subscription

    def _endpoint(self, role: Role, topic: str, kind: str, qos: QoS) -> Endpoint:
        check_kind(kind, self._config.distro)
        full = self.resolve(topic)
        token = self._layout.endpoint_token(role, full, kind, qos, self._id, next(self._numbers))
        key = self._layout.topic_key(full, kind)
        return Endpoint(full, kind, self._config.distro, qos, key, token, self._layout.gid(token))

    def _service_endpoint(self, name: str, kind: str, *, server: bool) -> ServiceEndpoint:
        distro = self._config.distro
        check_kind(f"{kind}_Request", distro)
        full = self.resolve(name)
        token = self._layout.service_token(full, kind, self._id, next(self._numbers), server=server)
        return ServiceEndpoint(full, kind, distro, self._layout.topic_key(full, kind), token, self._layout.gid(token))
