"""Publishers and subscriptions of a node."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import zenoh
import zenoh.ext

from common.bus.session import reason
from common.system.closing import Closing
from common.system.steady_time import steady_time_ns
from deploy.ros2.dispatch import Dispatcher, Inbox
from deploy.ros2.errors import RosError
from deploy.ros2.keys import Attachment
from deploy.ros2.messages import Message, deserialize, serialize
from deploy.ros2.qos import QoS

log = logging.getLogger(__name__)

HEARTBEAT = 0.5
"""How often a latched publisher of rmw_zenoh tells its newest number, seconds."""


@dataclass(frozen=True, slots=True)
class Received:
    """How a message came.

    Attributes:
        time: arrival, `time.monotonic()` seconds; for timeouts.
        wall_time: the same in nanoseconds since 1970, steady where the clock is set meanwhile; for recordings.
        size: of the payload, bytes.
        source_time: when it was published, nanoseconds since 1970, as the sender's clock tells; None in layouts
            without attachments.
        sequence: number of the message of its publisher, or None.
        publisher: gid of the publisher, or None.
    """

    time: float
    wall_time: int
    size: int
    source_time: int | None = None
    sequence: int | None = None
    publisher: bytes | None = None


@dataclass(frozen=True, slots=True)
class Endpoint:
    """What a publisher or subscription is declared with.

    Attributes:
        topic: absolute name after remapping.
        kind: message type.
        distro: distribution of the type.
        qos: quality of service.
        key: Zenoh key of the messages.
        token: liveliness token.
        gid: identity in attachments, or None.
    """

    topic: str
    kind: str
    distro: str
    qos: QoS
    key: str
    token: str
    gid: bytes | None


class Publisher(Closing):
    """Publishes messages of one type on one topic; safe to use from several threads.

    Attributes:
        topic: absolute name.
        kind: message type.
        sent: number of messages so far.
    """

    def __init__(self, session: zenoh.Session, endpoint: Endpoint) -> None:
        self.topic = endpoint.topic
        self.kind = endpoint.kind
        self.sent = 0
        self._endpoint = endpoint
        self._lock = threading.Lock()
        self._closed = False
        self._publisher = _declare_publisher(session, endpoint)
        self._token = session.liveliness().declare_token(endpoint.token)

    @property
    def heard(self) -> bool:
        """Whether anybody listens to the topic now, with the same type; what is latched is for those who come later."""
        if self._endpoint.qos.transient_local:
            return True
        with self._lock:
            return not self._closed and bool(self._publisher.matching_status.matching)

    def publish(self, message: Message) -> None:
        """Send a message; nobody needs to listen.

        Raises:
            RosError: when a field does not fit its type, or the node is closed.
        """
        self.publish_raw(serialize(message, self.kind, self._endpoint.distro))

    def publish_raw(self, payload: bytes) -> None:
        """Send a message that is CDR already.

        Raises:
            RosError: when the node is closed.
        """
        with self._lock:
            self.sent += 1
            gid = self._endpoint.gid
            attachment = None if gid is None else Attachment(self.sent, time.time_ns(), gid).pack()
            try:
                self._publisher.put(payload, attachment=attachment)
            except zenoh.ZError as error:
                raise RosError(f"cannot publish on {self.topic}: {reason(error)}; is the node closed?") from None

    def close(self) -> None:
        """Withdraw the publisher; late subscribers get its latched messages no more."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
        self._token.undeclare()
        self._publisher.undeclare()


class Subscription(Closing):
    """Receives the messages of one type on one topic, in the node's callback thread.

    A payload that is no such message, or from which a callback's conversion raises RosError, is counted and logged
    once. A callback that raises anything else is counted, and logged at the 1st, 2nd, 4th, 8th time and so on.

    Attributes:
        topic: absolute name.
        kind: message type.
        received: messages that the callback took.
        invalid: payloads that were no message of this type, or one without sense.
        failed: messages on which the callback failed.
    """

    def __init__(
        self,
        session: zenoh.Session,
        endpoint: Endpoint,
        dispatcher: Dispatcher,
        callback: Callable[[Any, Received], None],
        *,
        raw: bool = False,
    ) -> None:
        self.topic = endpoint.topic
        self.kind = endpoint.kind
        self.received = 0
        self.invalid = 0
        self.failed = 0
        self._endpoint = endpoint
        self._callback = callback
        self._raw = raw
        self._closed = False
        self._inbox: Inbox[tuple[zenoh.Sample, float]] = Inbox(dispatcher, endpoint.qos.depth, self._deliver)
        self._subscriber = _declare_subscriber(session, endpoint, self._arrived)
        self._token = session.liveliness().declare_token(endpoint.token)

    @property
    def dropped(self) -> int:
        """Messages that newer ones pushed out before the callback could take them."""
        return self._inbox.dropped

    def close(self) -> None:
        """Receive no more."""
        if self._closed:
            return
        self._closed = True
        self._inbox.close()
        self._token.undeclare()
        self._subscriber.undeclare()

    def _arrived(self, sample: zenoh.Sample) -> None:
        self._inbox.put((sample, time.monotonic()))

    def _deliver(self, item: tuple[zenoh.Sample, float]) -> None:
        sample, arrival = item
        payload = sample.payload.to_bytes()
        note = None if sample.attachment is None else Attachment.unpack(sample.attachment.to_bytes())
        how = Received(arrival, steady_time_ns(arrival), len(payload))
        if note is not None:
            how = replace(how, source_time=note.time, sequence=note.sequence, publisher=note.gid)
        try:
            message = payload if self._raw else deserialize(payload, self.kind, self._endpoint.distro)
            self._callback(message, how)
        except RosError as error:
            # Also from conversions: a message without sense is as bad as none.
            self.invalid += 1
            if self.invalid == 1:
                log.warning("%s: %s; such messages are skipped and counted", self.topic, error)
        except Exception:
            # The thread serves all topics of the node: one bad message must not silence the others.
            self.failed += 1
            if self.failed & (self.failed - 1) == 0:
                log.exception("the callback of %s failed, %d times so far", self.topic, self.failed)
        else:
            self.received += 1


class Latest(Closing):
    """Keeps the newest message of a topic; safe to read from any thread.

    Attributes:
        topic: absolute name.
        kind: message type.
    """

    def __init__(self, subscribe: Callable[[Callable[[Message, Received], None]], Subscription]) -> None:
        """Subscribe.

        Args:
            subscribe: makes a subscription with the callback that it is given.
        """
        self._newest: tuple[Message, Received] | None = None
        self._subscription = subscribe(self._put)
        self.topic = self._subscription.topic
        self.kind = self._subscription.kind

    def get(self) -> tuple[Message, Received] | None:
        """Return the newest message and how it came; None before the first."""
        return self._newest

    def age(self) -> float:
        """Return the seconds since the newest message arrived; infinite before the first."""
        newest = self._newest
        return float("inf") if newest is None else time.monotonic() - newest[1].time

    def close(self) -> None:
        """Receive no more; the newest message stays."""
        self._subscription.close()

    def _put(self, message: Message, received: Received) -> None:
        self._newest = (message, received)


def _declare_publisher(session: zenoh.Session, endpoint: Endpoint) -> Any:
    qos = endpoint.qos
    # As rmw_zenoh does: KEEP_LAST never blocks the publisher.
    settings: dict[str, Any] = {
        "encoding": zenoh.Encoding.APPLICATION_CDR,
        "congestion_control": zenoh.CongestionControl.DROP,
        "reliability": zenoh.Reliability.RELIABLE if qos.reliable else zenoh.Reliability.BEST_EFFORT,
    }
    if not qos.transient_local:
        return session.declare_publisher(endpoint.key, **settings)
    detection = None
    if qos.reliable:
        detection = zenoh.ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT)
    return zenoh.ext.declare_advanced_publisher(
        session,
        endpoint.key,
        cache=zenoh.ext.CacheConfig(qos.depth),
        publisher_detection=True,
        sample_miss_detection=detection,
        **settings,
    )


def _declare_subscriber(session: zenoh.Session, endpoint: Endpoint, arrived: Callable[[zenoh.Sample], None]) -> Any:
    qos = endpoint.qos
    # Not `indirect`: a callback that only queues needs no thread of its own, and an own thread would outlive errors.
    handler = zenoh.handlers.Callback(arrived, indirect=False)
    if not qos.transient_local:
        return session.declare_subscriber(endpoint.key, handler)
    return zenoh.ext.declare_advanced_subscriber(
        session,
        endpoint.key,
        handler,
        history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=qos.depth),
        recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True) if qos.reliable else None,
        subscriber_detection=True,
    )
