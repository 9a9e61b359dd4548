"""One topic on its way from one network to the other."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from deploy.relay.dds import DdsNode
from deploy.ros2 import Node, Publisher, Received, RosError
from deploy.routes import Route

log = logging.getLogger(__name__)


class Lane:
    """What both directions have in common.

    Attributes:
        route: topic, type, QoS.
        messages: that came through.
        bytes: of them.
        lost: messages that could not be sent on, or that newer ones pushed out.
    """

    def __init__(self, route: Route) -> None:
        self.route = route
        self.messages = 0
        self.bytes = 0
        self._failed = 0
        self._last: float | None = None

    @property
    def lost(self) -> int:
        """Messages that could not be sent on, or that newer ones pushed out."""
        return self._failed

    def status(self, now: float) -> dict[str, Any]:
        """Return the counters, ready for JSON."""
        return {
            "type": self.route.kind,
            "messages": self.messages,
            "bytes": self.bytes,
            "lost": self.lost,
            "age": None if self._last is None else round(now - self._last, 2),
        }

    def _count(self, payload: bytes) -> None:
        self.messages += 1
        self.bytes += len(payload)
        self._last = time.monotonic()

    def _failure(self, error: Exception) -> None:
        self._failed += 1
        if self._failed & (self._failed - 1) == 0:
            log.warning("%s: a message could not be sent on, %d so far: %s", self.route.topic, self._failed, error)


class ToBridge(Lane):
    """From DDS to Zenoh.

    A publisher that offers less than is asked would not be heard at all: then less is asked. Where one topic has
    latched and volatile publishers, both are subscribed to, and what is latched may come twice.
    """

    def __init__(self, route: Route, dds: DdsNode, node: Node) -> None:
        """Carry a topic from now on.

        Raises:
            RosError: its type cannot be had.
        """
        super().__init__(route)
        self._dds = dds
        # Of a button that was pressed and let go, a bridge that starts later hears what it said last.
        offered = replace(route.qos, depth=1) if route.any_durability else route.qos
        self._publisher: Publisher = node.publisher(route.topic, route.kind, offered)
        self._lock = threading.Lock()
        self._mismatched: set[str] = set()
        self._qos = route.qos
        durabilities = {False, True} if route.any_durability else {route.qos.transient_local}
        self._subscriptions = [self._subscribe(latched) for latched in sorted(durabilities)]

    def adapt(self) -> None:
        """Ask for less where a publisher offers less; not to be called from the DDS thread."""
        with self._lock:
            policies, self._mismatched = self._mismatched, set()
        if "RELIABILITY" in policies and self._qos.reliable:
            log.warning("%s: a publisher is best effort, so messages may get lost on the way", self.route.topic)
            self._qos = replace(self._qos, reliable=False)
            old, durabilities = self._subscriptions, {self.route.qos.transient_local}
            if len(old) > 1:
                durabilities.add(False)
            self._subscriptions = [self._subscribe(latched) for latched in sorted(durabilities)]
            for each in old:
                self._dds.unsubscribe(each)
        if "DURABILITY" in policies and self._qos.transient_local and len(self._subscriptions) == 1:
            log.warning(
                "%s: a publisher does not keep its last message (it is volatile, not transient local): what it sent "
                "before the relay started is lost",
                self.route.topic,
            )
            self._subscriptions.append(self._subscribe(latched=False))
        for policy in policies - {"RELIABILITY", "DURABILITY"}:
            log.warning("%s: messages of a publisher cannot be received, because of its %s", self.route.topic, policy)

    def _subscribe(self, latched: bool) -> Any:
        qos = replace(self._qos, transient_local=latched)
        return self._dds.subscribe(self.route.topic, self.route.kind, qos, self._take, self._mismatch)

    def _mismatch(self, policy: str) -> None:
        with self._lock:
            self._mismatched.add(policy)

    def _take(self, payload: bytes) -> None:
        try:
            self._publisher.publish_raw(payload)
        except RosError as error:
            self._failure(error)
        else:
            self._count(payload)


class ToRobot(Lane):
    """From Zenoh to DDS.

    Attributes:
        tell: called with every message that has gone to the robot, where anybody wants to know.
    """

    def __init__(self, route: Route, dds: DdsNode, node: Node) -> None:
        """Declare the publisher in DDS; `follow` begins to listen in Zenoh.

        Raises:
            RosError: its type cannot be had.
        """
        super().__init__(route)
        self._dds = dds
        self._node = node
        self._pushed_out = 0
        self.tell: Callable[[bytes], None] | None = None
        self._publish = dds.publisher(route.topic, route.kind, route.qos, self._mismatch)
        self._subscription: Any = None

    @property
    def lost(self) -> int:
        """Messages that could not be sent on, or that newer ones pushed out."""
        return self._failed + self._pushed_out + (0 if self._subscription is None else self._subscription.dropped)

    def follow(self) -> None:
        """Listen in Zenoh, to what is mirrored only while somebody in DDS listens."""
        route = self.route
        wanted = not route.mirrored or any(peer.kind == route.kind for peer in self._dds.subscriptions_to(route.topic))
        if wanted and self._subscription is None:
            self._subscription = self._node.subscribe_raw(route.topic, route.kind, self._take, route.qos)
        elif not wanted and self._subscription is not None:
            self._subscription.close()
            self._pushed_out += self._subscription.dropped
            self._subscription = None

    def send(self, payload: bytes) -> None:
        """Send a message of the relay's own to the robot."""
        try:
            self._publish(payload)
        except RosError as error:
            self._failure(error)
        else:
            self._count(payload)

    def _take(self, payload: bytes, received: Received) -> None:
        del received
        self.send(payload)
        if self.tell is not None:
            self.tell(payload)

    def _mismatch(self, policy: str) -> None:
        if policy not in {"RELIABILITY", "DURABILITY"}:
            # The graph monitor says who asks for what.
            return
        log.warning(
            "%s: a subscription receives nothing, because it requests more %s than is offered (%s)",
            self.route.topic,
            policy.lower(),
            "transient local" if self.route.qos.transient_local else "volatile",
        )
