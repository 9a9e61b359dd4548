"""Reads bags: our own, those of `ros2 bag` in both storages, and files whose writer was killed."""

from __future__ import annotations

import logging
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zstandard
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Chunk, Message, Schema
from mcap.stream_reader import CRCValidationError, StreamReader
from pydantic import ValidationError
from rosbags.highlevel import AnyReader, AnyReaderError

from deploy.config import DeployConfig
from deploy.recording.chunks import MAX_CHUNK, records_in
from deploy.recording.errors import RecordingError
from deploy.recording.writer import CONFIG_NAME, BagWriter
from deploy.ros2.qos import RELIABLE

log = logging.getLogger(__name__)

_MAGIC = b"\x89MCAP0\r\n"
_LARGEST_RECORD = MAX_CHUNK + (1 << 20)


@dataclass(frozen=True, slots=True)
class Recorded:
    """One message of a recording.

    Attributes:
        topic: absolute name.
        kind: message type.
        time: arrival, nanoseconds since 1970.
        payload: CDR.
    """

    topic: str
    kind: str
    time: int
    payload: bytes


def read_bag(path: Path) -> Iterator[Recorded]:
    """Yield the messages of a recording in the order of the file.

    Args:
        path: folder of a bag, or an MCAP file. A file that ends in the middle is read as far as it goes.

    Raises:
        RecordingError: there is no recording.
    """
    files = _mcap_files(path)
    if files:
        for file in files:
            yield from _read_mcap(file)
    else:
        yield from _read_with_rosbags(path)


def recorded_config(path: Path) -> DeployConfig | None:
    """Return the parameters of the robot that was recorded; None where the recording holds none.

    Raises:
        RecordingError: there is no recording.
    """
    for file in _mcap_files(path):
        for record in _records(file):
            if isinstance(record, Attachment) and record.name == CONFIG_NAME:
                try:
                    return DeployConfig.model_validate_json(record.data)
                except ValidationError as error:
                    log.warning("%s holds parameters of another version: %s", file, error)
            if isinstance(record, Message):
                # They stand before the first message.
                return None
    return None


def recover(path: Path, out: Path) -> int:
    """Copy what can be read of an MCAP recording into a new bag that is whole, and return the number of messages.

    Raises:
        RecordingError: there is no recording, or `out` exists.
    """
    files = _mcap_files(path)
    if not files:
        raise RecordingError(f"{path} holds no MCAP file: name the folder of a bag or an .mcap file")
    with BagWriter(out, config=recorded_config(path)) as bag:
        for file in files:
            schemas: dict[int, Schema] = {}
            copies: dict[int, int] = {}
            for record in _records(file):
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel) and record.id not in copies:
                    schema = schemas[record.schema_id]
                    text = schema.data.decode("utf-8", "replace")
                    copies[record.id] = bag.add_topic(record.topic, schema.name, RELIABLE, text)
                elif isinstance(record, Message):
                    copy = copies[record.channel_id]
                    bag.write(copy, record.data, record.log_time, record.publish_time, record.sequence)
        return bag.count


def _mcap_files(path: Path) -> list[Path]:
    if path.is_file() and path.suffix == ".mcap":
        return [path]
    if not path.is_dir():
        raise RecordingError(f"there is no recording at {path}: name the folder of a bag or an .mcap file")
    # Storage files end in a number, which is no text: _10 comes after _9.
    return sorted(path.glob("*.mcap"), key=lambda file: (len(file.name), file.name))


def _read_mcap(path: Path) -> Iterator[Recorded]:
    kinds: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    for record in _records(path):
        if isinstance(record, Schema):
            kinds[record.id] = record.name
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Message):
            channel = channels.get(record.channel_id)
            if channel is not None and channel.message_encoding == "cdr":
                kind = kinds.get(channel.schema_id, "")
                yield Recorded(channel.topic, kind, record.log_time, bytes(record.data))


def _records(path: Path) -> Iterator[Any]:
    """Yield the records of an MCAP file up to its end, or to where it breaks off."""
    with path.open("rb") as stream:
        if stream.read(len(_MAGIC)) != _MAGIC:
            raise RecordingError(f"{path} is no MCAP file: it begins with other bytes")
        records = StreamReader(stream, skip_magic=True, emit_chunks=True, record_size_limit=_LARGEST_RECORD).records
        while True:
            try:
                record = next(records)
                found = records_in(record, path) if isinstance(record, Chunk) else [record]
            except StopIteration:
                return
            except (
                McapError,
                CRCValidationError,
                zstandard.ZstdError,
                struct.error,
                ValueError,
                RuntimeError,
            ) as error:
                # RuntimeError is what LZ4 raises.
                position = stream.tell()
                log.warning("%s breaks off near byte %d, the rest is lost: %s", path, position, error or "end of file")
                return
            yield from found


def _read_with_rosbags(path: Path) -> Iterator[Recorded]:
    try:
        with AnyReader([path]) as reader:
            for connection, time, payload in reader.messages():
                yield Recorded(connection.topic, connection.msgtype, time, bytes(payload))
    except (AnyReaderError, OSError) as error:
        raise RecordingError(f"cannot read the recording {path}: {error}") from None
