"""Writes bags: a folder with one MCAP file of profile `ros2` and its `metadata.yaml`."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import threading
import time
from collections.abc import Iterator
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

    After every `flush` the file holds all that was written before it, whatever happens to this process. A disk that
    refuses something ends the bag there: what was flushed stays and can be read, and no more is taken.

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
            RecordingError: the folder exists already or cannot be made, or the disk is full: nothing is left then.
        """
        self.path = path
        self.topics: dict[int, BagTopic] = {}
        self.size = 0
        self._distro = distro
        self._lock = threading.Lock()
        self._schemas: dict[str, int] = {}
        self._start = self._end = 0
        self._closed = False
        # Bytes of the file that are whole records, as the last flush left them.
        self._sound = 0
        try:
            path.mkdir(parents=True)
            self._file = path / f"{path.name}_0.mcap"
            self._stream = self._file.open("xb")
        except OSError as error:
            raise RecordingError(f"cannot start a recording in {path}: {error}; choose another --out") from None
        self._writer: Any = Writer(self._stream, chunk_size=_CHUNK, compression=_KINDS[compression])
        try:
            with self._ending_the_bag():
                self._writer.start(profile="ros2", library="hdplanner")
                if config is not None:
                    now, text = time.time_ns(), config.model_dump_json()
                    self._writer.add_attachment(now, now, CONFIG_NAME, "application/json", text.encode())
            self.flush()
        except RecordingError:
            shutil.rmtree(path)
            raise

    @property
    def count(self) -> int:
        """Messages so far."""
        return sum(topic.count for topic in self.topics.values())

    def add_topic(
        self, name: str, kind: str, qos: QoS, definition: str | None = None, language: str = "ros2msg"
    ) -> int:
        """Begin a topic and return its channel.

        Args:
            name: absolute.
            kind: message type; the distribution must know it, unless `definition` is given.
            qos: of its publisher.
            definition: text of the message definition, with those of all its parts.
            language: what that is written in, ``ros2msg`` or ``ros2idl``.
        """
        with self._lock:
            if kind not in self._schemas:
                text = definition or typestore(self._distro).generate_msgdef(kind, ros_version=2)[0]
                self._schemas[kind] = self._writer.register_schema(kind, language, text.encode())
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
            RecordingError: the disk is full; after that nothing is taken and nothing is raised.
        """
        with self._lock:
            if self._closed:
                return
            self._start = arrival if self._start == 0 else min(self._start, arrival)
            self._end = max(self._end, arrival)
            self.topics[channel].count += 1
            self.size += len(payload)
            at = arrival if published is None else published
            with self._ending_the_bag():
                self._writer.add_message(channel, arrival, payload, at, sequence & 0xFFFFFFFF)

    def flush(self) -> None:
        """Bring everything into the file, and the metadata up to date.

        Raises:
            RecordingError: the disk is full.
        """
        with self._lock:
            if not self._closed:
                with self._ending_the_bag():
                    self._writer.flush()
                    self._sound = self._stream.tell()
                    self._write_metadata()

    def close(self) -> None:
        """Write the index and close the file; safe to call twice.

        Raises:
            RecordingError: the disk is full; the messages that were flushed can be read.
        """
        with self._lock:
            if self._closed:
                return
            with self._ending_the_bag():
                self._writer.finish()
                self._stream.close()
                self._closed = True
                self._write_metadata()

    @contextlib.contextmanager
    def _ending_the_bag(self) -> Iterator[None]:
        """Let a disk that refuses something end the bag behind its last whole record."""
        try:
            yield
        except OSError as error:
            if not self._closed:
                self._closed = True
                with contextlib.suppress(OSError):
                    self._stream.close()  # it tries to write what it still holds
                os.truncate(self._file, self._sound)
            self._fresh_metadata.unlink(missing_ok=True)
            raise RecordingError(
                f"cannot write to {self.path}: {error.strerror}; make room on the disk. Earlier data is readable, "
                "and `hd-deploy recover` turns it into a complete bag"
            ) from error

    @property
    def _fresh_metadata(self) -> Path:
        return self.path / "metadata.yaml.new"

    def _write_metadata(self) -> None:
        known = typestore(self._distro).fielddefs
        topics = [topic for topic in self.topics.values() if topic.kind in known]
        text = bag_metadata(self._file.name, topics, self._start, self._end, self._distro)
        self._fresh_metadata.write_text(text, "utf-8")
        self._fresh_metadata.replace(self.path / "metadata.yaml")
