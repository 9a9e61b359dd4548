"""The relay's end in the DDS network: a node of rclpy that takes and gives bytes."""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from common.system.closing import Closing
from deploy.relay.made_types import forget_errors
from deploy.relay.rclpy_types import load_rclpy, message_class, service_class
from deploy.ros2.errors import RosError
from deploy.ros2.qos import QoS

log = logging.getLogger(__name__)

DOMAIN_VARIABLE: Final = "ROS_DOMAIN_ID"
_EARS: Final = "_relay"
# A duration that is longer stands for ever in DDS.
_FOREVER_NS: Final = 10**18
# How long the end waits for a thread, seconds.
_END: Final = 2.0


@dataclass(frozen=True, slots=True)
class Peer:
    """A publisher or subscription of another node.

    Attributes:
        node: full name.
        kind: message type that it speaks.
        type_hash: of that type, or empty where its middleware tells none.
        qos: what it offers or asks.
        promise: what else it offers or asks that not every publisher offers, in words; empty for nothing.
    """

    node: str
    kind: str
    type_hash: str
    qos: QoS
    promise: str = ""


class DdsNode(Closing):
    """A node with raw publishers and services, and one beside it, `<name>_relay`, with the raw subscriptions.

    Each has a thread for its callbacks, because topics must be served while a service waits for its answer.

    Usage::

        with DdsNode("hd_bridge", "/", domain=0, distro="kilted") as node:
            velocity = node.publisher("/cmd_vel", "geometry_msgs/msg/Twist", RELIABLE, log.warning)
            node.subscribe("/scan", "sensor_msgs/msg/LaserScan", SENSOR, take, log.warning)
            velocity(payload)
    """

    def __init__(self, name: str, namespace: str, *, domain: int, distro: str) -> None:
        """Join the DDS network.

        Args:
            name: of the node.
            namespace: in full.
            domain: ROS_DOMAIN_ID.
            distro: distribution whose definitions types are made from that are not installed.

        Raises:
            RosError: rclpy is missing, or the node cannot be made.
        """
        self.name = name
        self.full_name = f"{namespace.rstrip('/')}/{name}"
        self._distro = distro
        self._rclpy = load_rclpy()
        self._context = self._rclpy.Context()
        self._closed = False
        from rclpy.executors import SingleThreadedExecutor

        try:
            # Signals belong to the process, which ends the robot's motion before it leaves.
            self._context.init(domain_id=domain)
            self._node, self._ears = (
                self._rclpy.create_node(
                    each,
                    namespace=namespace,
                    context=self._context,
                    start_parameter_services=False,
                    enable_rosout=False,
                )
                for each in (name, f"{name}{_EARS}")
            )
        except Exception as error:
            # rclpy raises types of its own for names, domains and middlewares.
            raise RosError(f"cannot join DDS as {self.full_name} in domain {domain}: {error}") from error
        self._executors = []
        self._threads = []
        for node in (self._node, self._ears):
            executor = SingleThreadedExecutor(context=self._context)
            executor.add_node(node)
            thread = threading.Thread(target=self._spin, args=(executor,), name=node.get_name(), daemon=True)
            thread.start()
            self._executors.append(executor)
            self._threads.append(thread)

    def publisher(self, topic: str, kind: str, qos: QoS, on_mismatch: Callable[[str], None]) -> Callable[[bytes], None]:
        """Declare a publisher and return what publishes a message that is CDR; it may be called from any thread.

        Args:
            topic: absolute name.
            kind: message type.
            qos: offered.
            on_mismatch: called with the name of a policy when a subscription asks for more than is offered.
        """
        from rclpy.event_handler import PublisherEventCallbacks

        events = PublisherEventCallbacks(
            incompatible_qos=lambda info: on_mismatch(_policy(info)), use_default_callbacks=False
        )
        made = message_class(kind, self._distro)
        publisher = self._node.create_publisher(made, topic, _profile(qos), event_callbacks=events)
        forget_errors()

        def publish(payload: bytes) -> None:
            try:
                publisher.publish(payload)
            except Exception as error:
                # rclpy raises types of its own.
                raise RosError(f"DDS does not take it: {error}") from error

        return publish

    def subscribe(
        self,
        topic: str,
        kind: str,
        qos: QoS,
        callback: Callable[[bytes], None],
        on_mismatch: Callable[[str], None],
    ) -> Any:
        """Call `callback(payload)` with the CDR of every message.

        Args:
            topic: absolute name.
            kind: message type.
            qos: asked.
            callback: must not block.
            on_mismatch: called with the name of a policy when a publisher offers less than is asked.
        """
        from rclpy.event_handler import SubscriptionEventCallbacks

        events = SubscriptionEventCallbacks(
            incompatible_qos=lambda info: on_mismatch(_policy(info)), use_default_callbacks=False
        )
        made = message_class(kind, self._distro)
        subscription = self._ears.create_subscription(
            made, topic, callback, _profile(qos), event_callbacks=events, raw=True
        )
        forget_errors()
        return subscription

    def unsubscribe(self, subscription: Any) -> None:
        """Withdraw a subscription."""
        self._ears.destroy_subscription(subscription)

    def service(self, name: str, kind: str, call: Callable[[bytes], bytes]) -> bool:
        """Offer a service whose answers another network gives; return whether its type is installed.

        Args:
            name: absolute name.
            kind: service type.
            call: makes the CDR of a response from that of a request; may block, and raise RosError when nobody
                answers: the asker gets the type's default response then, because ROS 2 knows no error.
        """
        made = service_class(kind)
        if made is None:
            return False
        from rclpy.serialization import deserialize_message, serialize_message

        def take(request: Any, response: Any) -> Any:
            try:
                return deserialize_message(call(serialize_message(request)), made.Response)
            except RosError as error:
                log.warning("service %s: %s", name, error)
            except Exception:
                # Without an answer the asker would wait for ever.
                log.exception("service %s failed", name)
            return response

        self._node.create_service(made, name, take)
        return True

    def publishers_of(self, topic: str) -> list[Peer]:
        """Return the publishers that other nodes have on a topic."""
        return self._peers(self._node.get_publishers_info_by_topic(topic))

    def subscriptions_to(self, topic: str) -> list[Peer]:
        """Return the subscriptions that other nodes have to a topic."""
        return self._peers(self._node.get_subscriptions_info_by_topic(topic))

    def published(self) -> dict[str, list[str]]:
        """Return the topics that other nodes publish, with their types; hidden ones are left out."""
        return {
            topic: kinds
            for topic, kinds in sorted(self._node.get_topic_names_and_types())
            if "/_" not in topic and self.publishers_of(topic)
        }

    def alone(self) -> bool:
        """Whether no other node is in the domain, but hidden ones of tools."""
        return all(
            name.startswith("_") or f"{within.rstrip('/')}/{name}" in {self.full_name, f"{self.full_name}{_EARS}"}
            for name, within in self._node.get_node_names_and_namespaces()
        )

    def namesakes(self) -> int:
        """Return how many other nodes have this one's full name."""
        found = self._node.get_node_names_and_namespaces()
        return sum(f"{within.rstrip('/')}/{name}" == self.full_name for name, within in found) - 1

    def close(self) -> None:
        """Leave the DDS network. Safe to call twice."""
        if self._closed:
            return
        self._closed = True
        for executor in self._executors:
            executor.shutdown(timeout_sec=_END)
        for thread in self._threads:
            thread.join(_END)
        for node in (self._ears, self._node):
            node.destroy_node()
        self._context.try_shutdown()

    def _spin(self, executor: Any) -> None:
        from rclpy.executors import ExternalShutdownException, ShutdownException

        while not self._closed:
            try:
                executor.spin()
            except (ExternalShutdownException, ShutdownException):
                return
            except Exception:
                # One bad moment must not silence all topics.
                log.exception("a DDS thread of the relay failed, and continues")

    def _peers(self, infos: list[Any]) -> list[Peer]:
        from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

        peers = []
        for info in infos:
            node = f"{info.node_namespace.rstrip('/')}/{info.node_name}"
            if node in {self.full_name, f"{self.full_name}{_EARS}"}:
                continue
            asked = QoS(
                info.qos_profile.reliability is not ReliabilityPolicy.BEST_EFFORT,
                info.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL,
                max(info.qos_profile.depth, 1),
            )
            known = getattr(info, "topic_type_hash", None)
            type_hash = "" if known is None or known.version < 1 else str(known)
            peers.append(Peer(node, info.topic_type, type_hash, asked, _promise(info.qos_profile)))
        return peers


def domain_of(domain: int, *, given: bool, environment: Mapping[str, str] = os.environ) -> int:
    """Return the DDS domain: that of the parameters where they give one, else ROS_DOMAIN_ID, as all of ROS 2 does.

    Raises:
        RosError: ROS_DOMAIN_ID is no domain.
    """
    text = environment.get(DOMAIN_VARIABLE, "")
    if given or not text:
        return domain
    if not text.isdecimal() or int(text) > 232:
        raise RosError(f"{DOMAIN_VARIABLE} must be a number from 0 to 232, got {text!r}: correct it, or set ros.domain")
    return int(text)


def _profile(qos: QoS) -> Any:
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE if qos.reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if qos.transient_local else DurabilityPolicy.VOLATILE,
        history=HistoryPolicy.KEEP_LAST,
        depth=qos.depth,
    )


def _promise(profile: Any) -> str:
    """Return the deadline and the liveliness of a QoS in words; empty where it has none."""
    from rclpy.qos import LivelinessPolicy

    told = []
    durations = ("deadline", profile.deadline), ("lease of liveliness", profile.liveliness_lease_duration)
    for name, duration in durations:
        # Not given is 0.
        if 0 < duration.nanoseconds < _FOREVER_NS:
            told.append(f"a {name} of {duration.nanoseconds * 1e-9:g} s")
    if profile.liveliness is LivelinessPolicy.MANUAL_BY_TOPIC:
        told.append("manual liveliness")
    return " and ".join(told)


def _policy(info: Any) -> str:
    from rclpy.qos import qos_policy_name_from_kind

    return str(qos_policy_name_from_kind(info.last_policy_kind)).rsplit(".", 1)[-1].removesuffix("_POLICY")
