"""Writes bags: a folder with one MCAP file of profile `ros2` and its `metadata.yaml`."""

from __future__ import annotations

import json
import threading
import time
from pathlib import Path
from typing import Any, Literal

from mcap.writer import CompressionType, Writer

from common.system.closing import Closing
from deploy.config import DeployConfig
from deploy.recording.errors import RecordingError
from deploy.recording.metadata import BagTopic, bag_metadata, qos_profiles
from deploy.ros2.messages import type_hash, typestore
from deploy.ros2.qos import QoS

Compression = Literal["none", "lz4", "zstd"]

CONFIG_NAME = "deploy.json"
"""Attachment with the parameters of the robot that was recorded."""

_CHUNK = 1 << 20
_KINDS = {"none": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}


class BagWriter(Closing):
    """Writes messages as they came; safe to use from several threads.

    After every `flush` the file holds all that was written before it, whatever happens to this process.

    Usage::

        with BagWriter(Path("recording")) as bag:
            channel = bag.add_topic("/scan", "sensor_msgs/msg/LaserScan", SENSOR)
            bag.write(channel, payload, time.time_ns())

    Attributes:
        path: folder of the bag.
        topics: by channel.
        size: bytes of payload so far.
    """

    def __init__(
        self,
        path: Path,
        distro: str = "jazzy",
        compression: Compression = "zstd",
        config: DeployConfig | None = None,
    ) -> None:
        """Begin a bag.

        Args:
            path: folder to make; it must not exist.
            distro: ROS 2 distribution whose definitions describe the messages.
            compression: of the chunks in the file.
            config: parameters of the robot, kept in the file.

        Raises:
            RecordingError: the folder exists already or cannot be made.
        """
        self.path = path
        self.topics: dict[int, BagTopic] = {}
        self.size = 0
        self._distro = distro
        self._lock = threading.Lock()
        self._schemas: dict[str, int] = {}
        self._start = self._end = 0
        self._closed = False
        try:
            path.mkdir(parents=True)
            self._file = path / f"{path.name}_0.mcap"
            self._stream = self._file.open("xb")
        except OSError as error:
            raise RecordingError(f"cannot begin a recording in {path}: {error}; choose another --out") from None
        self._writer: Any = Writer(self._stream, chunk_size=_CHUNK, compression=_KINDS[compression])
        self._writer.start(profile="ros2", library="hdplanner")
        if config is not None:
            now = time.time_ns()
            self._writer.add_attachment(now, now, CONFIG_NAME, "application/json", config.model_dump_json().encode())
        self.flush()

    @property
    def count(self) -> int:
        """Messages so far."""
        return sum(topic.count for topic in self.topics.values())

    def add_topic(self, name: str, kind: str, qos: QoS, definition: str | None = None) -> int:
        """Begin a topic and return its channel.

        Args:
            name: absolute.
            kind: message type; the distribution must know it, unless `definition` is given.
            qos: of its publisher.
            definition: text of the message definition, with those of all its parts.
        """
        with self._lock:
            if kind not in self._schemas:
                text = definition or typestore(self._distro).generate_msgdef(kind, ros_version=2)[0]
                self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", text.encode())
            notes = {"offered_qos_profiles": json.dumps(qos_profiles(qos))}
            if kind in typestore(self._distro).fielddefs:
                notes["topic_type_hash"] = type_hash(kind, self._distro)
            channel = self._writer.register_channel(name, "cdr", self._schemas[kind], notes)
            self.topics[channel] = BagTopic(name, kind, qos)
            return channel

    def write(
        self, channel: int, payload: bytes, arrival: int, published: int | None = None, sequence: int = 0
    ) -> None:
        """Add a message.

        Args:
            channel: from `add_topic`.
            payload: CDR.
            arrival: nanoseconds since 1970.
            published: the same by the publisher's clock, when it is known.
            sequence: number of the message of its publisher.

        Raises:
            OSError: the disk is full.
        """
        with self._lock:
            if self._closed:
                return
            self._start = arrival if self._start == 0 else min(self._start, arrival)
            self._end = max(self._end, arrival)
            self.topics[channel].count += 1
            self.size += len(payload)
            at = arrival if published is None else published
            self._writer.add_message(channel, arrival, payload, at, sequence & 0xFFFFFFFF)

    def flush(self) -> None:
        """Bring everything into the file, and the metadata up to date.

        Raises:
            OSError: the disk is full.
        """
        with self._lock:
            if not self._closed:
                self._writer.flush()
                self._write_metadata()

    def close(self) -> None:
        """Write the index and close the file."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            try:
                self._writer.finish()
                self._write_metadata()
            finally:
                self._stream.close()

    def _write_metadata(self) -> None:
        known = typestore(self._distro).fielddefs
        topics = [topic for topic in self.topics.values() if topic.kind in known]
        text = bag_metadata(self._file.name, topics, self._start, self._end, self._distro)
        fresh = self.path / "metadata.yaml.new"
        fresh.write_text(text, "utf-8")
        fresh.replace(self.path / "metadata.yaml")
