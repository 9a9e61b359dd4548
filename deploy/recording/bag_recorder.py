"""Records what goes over a robot's topics, our own decisions included."""

from __future__ import annotations

import functools
import logging
import re
import threading
import time
from collections.abc import Callable, Sequence
from fnmatch import fnmatchcase

from common.system.closing import Closing
from deploy.network_config import RosConfig, guest_of
from deploy.recording.errors import RecordingError
from deploy.recording.writer import BagWriter
from deploy.ros2 import Node, QoS, Received
from deploy.ros2.graph import SeenEndpoint, read_graph
from deploy.ros2.messages import typestore

log = logging.getLogger(__name__)

_LOOK = 1.0
_FLUSH = 1.0
# A disk may stand still for a moment; the node's queues bridge it, within bounds of memory.
_DEPTH = 1000
_DEPTH_OF_LARGE = 50
# Actions have types of their own, for which bags know no definitions.
_MESSAGE = re.compile(r"\w+/msg/\w+")
_LARGE = frozenset(
    {
        "nav_msgs/msg/OccupancyGrid",
        "sensor_msgs/msg/CompressedImage",
        "sensor_msgs/msg/Image",
        "sensor_msgs/msg/PointCloud2",
        "visualization_msgs/msg/MarkerArray",
    }
)

Listener = Callable[[str, str, bytes, int], None]
"""Gets topic, type, payload and arrival (nanoseconds) of every message, in the recorder's thread."""


class BagRecorder(Closing):
    """Subscribes to every topic that somebody publishes, also to those that appear later, and writes all to a bag.

    Usage::

        with BagWriter(path, config=config) as bag, BagRecorder(config.ros, bag) as recorder:
            recorder.run(stop)
    """

    def __init__(
        self,
        ros: RosConfig,
        bag: BagWriter,
        topics: Sequence[str] = (),
        exclude: Sequence[str] = (),
        listener: Listener | None = None,
    ) -> None:
        """Join the network.

        Args:
            ros: the robot's network.
            bag: to write to.
            topics: patterns such as `/hd/*` of the topics to record; all but hidden ones when empty.
            exclude: patterns of topics to leave out.
            listener: gets the messages as well.

        Raises:
            RosError: an endpoint is malformed.
        """
        self._bag = bag
        self._patterns = tuple(topics)
        self._excluded = tuple(exclude)
        self._listener = listener
        self._distro = ros.distro
        self._domain = ros.domain
        self._known: set[tuple[str, str]] = set()
        self._broken: RecordingError | None = None
        self._node = Node(guest_of(ros), "hd_recorder")

    def run(self, stop: threading.Event, duration: float = float("inf")) -> None:
        """Record until `stop` is set or so many seconds have passed.

        Raises:
            RecordingError: the disk is full, or the file cannot be written any more.
        """
        begin = time.monotonic()
        next_look = next_flush = begin
        while not stop.wait(0.1):
            now = time.monotonic()
            if now - begin >= duration:
                break
            if now >= next_look:
                self.look()
                next_look = time.monotonic() + _LOOK
            if now >= next_flush:
                self.flush()
                next_flush = time.monotonic() + _FLUSH
        self.flush()

    def look(self) -> None:
        """Subscribe to topics that have appeared."""
        for name, endpoints in read_graph(self._node.session, self._domain).topics().items():
            publishers = [one for one in endpoints if one.role == "publisher"]
            if publishers and self._wants(name):
                self._subscribe(name, publishers)

    def flush(self) -> None:
        """Bring what was recorded so far into the file.

        Raises:
            RecordingError: it cannot be written.
        """
        self._bag.flush()
        if self._broken is not None:
            raise self._broken

    def close(self) -> None:
        """Leave the network; the bag stays open."""
        self._node.close()

    def _wants(self, name: str) -> bool:
        # As with `ros2 bag record`: those of actions and services are hidden, and recorded when they are asked for.
        hidden = any(part.startswith("_") for part in name.split("/"))
        wanted = any(fnmatchcase(name, pattern) for pattern in self._patterns) if self._patterns else not hidden
        return wanted and not any(fnmatchcase(name, pattern) for pattern in self._excluded)

    def _subscribe(self, name: str, publishers: Sequence[SeenEndpoint]) -> None:
        for kind in sorted({one.kind for one in publishers}):
            if (name, kind) in self._known:
                continue
            self._known.add((name, kind))
            if kind not in typestore(self._distro).fielddefs or not _MESSAGE.fullmatch(kind):
                log.warning("%s is not recorded: its type %s is unknown, or no message type", name, kind)
                continue
            offered = [one.qos for one in publishers if one.kind == kind]
            latched = any(qos.transient_local for qos in offered)
            qos = QoS(all(one.reliable for one in offered), latched, max(one.depth for one in offered))
            channel = self._bag.add_topic(name, kind, qos)
            store = functools.partial(self._store, name, kind, channel)
            depth = _DEPTH_OF_LARGE if kind in _LARGE else _DEPTH
            self._node.subscribe_raw(name, kind, store, QoS(qos.reliable, latched, depth))
            log.info("recording %s (%s)", name, kind)

    def _store(self, name: str, kind: str, channel: int, payload: bytes, received: Received) -> None:
        try:
            self._bag.write(channel, payload, received.wall_time, received.source_time, received.sequence or 0)
        except RecordingError as error:
            self._broken = error
        if self._listener is not None:
            self._listener(name, kind, payload, received.wall_time)
