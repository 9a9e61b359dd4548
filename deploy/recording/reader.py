"""Reads bags: our own, those of `ros2 bag` in both storages, compressed or not, and files whose writer was killed."""

from __future__ import annotations

import logging
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, cast

import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Message, Schema
from mcap.stream_reader import CRCValidationError, StreamReader
from pydantic import ValidationError

from deploy.config import DeployConfig
from deploy.recording.chunks import MAX_CHUNK, records_before_cut, records_in
from deploy.recording.errors import RecordingError
from deploy.recording.storage import (
    LEFT_OUT,
    missing_files,
    plain_payload,
    read_sqlite,
    storage_files,
    storage_of,
    uncompressed,
)
from deploy.recording.storage import Recorded as Recorded  # noqa: PLC0414  (exported from here too)
from deploy.recording.writer import CONFIG_NAME, BagWriter
from deploy.ros2.messages import typestore
from deploy.ros2.qos import RELIABLE

log = logging.getLogger(__name__)

_MAGIC = b"\x89MCAP0\r\n"
_LARGEST_RECORD = MAX_CHUNK + (1 << 20)
# Opcode and length of a record.
_RECORD = struct.Struct("<BQ")
# RuntimeError is what LZ4 raises, OverflowError what a length beyond all files does.
_DAMAGE = (
    McapError,
    CRCValidationError,
    zstandard.ZstdError,
    struct.error,
    ValueError,
    RuntimeError,
    OverflowError,
)


def read_bag(path: Path) -> Iterator[Recorded]:
    """Yield the messages of a recording in the order of its files.

    Args:
        path: folder of a bag, or one of its storage files (`.mcap`, `.db3`, perhaps compressed). A file that ends in
            the middle is read as far as it goes.

    Raises:
        RecordingError: there is no recording.
    """
    files = _files(path)
    for file in files:
        with uncompressed(file) as plain:
            if plain.stat().st_size:
                yield from _read_mcap(plain) if storage_of(plain) == ".mcap" else read_sqlite(plain)
                continue
        problem = f"{file} holds nothing: its recorder was ended before it wrote anything"
        if file.stat().st_size:
            problem = f"{file} holds nothing that can be unpacked: copy it again, or name it without {file.suffix}"
        if len(files) == 1:
            raise RecordingError(problem)
        log.warning(problem)


def recorded_config(path: Path) -> DeployConfig | None:
    """Return the parameters of the robot that was recorded; None where the recording holds none.

    Raises:
        RecordingError: there is no recording.
    """
    for file in storage_files(path):
        # Our recorder keeps them in plain MCAP files.
        if file.suffix != ".mcap" or file.stat().st_size == 0:
            continue
        for record in _records(file):
            if isinstance(record, Attachment) and record.name == CONFIG_NAME:
                try:
                    return DeployConfig.model_validate_json(record.data)
                except ValidationError as error:
                    log.warning("%s has parameters of another version: %s", file, error)
            if isinstance(record, Message):
                # They stand before the first message.
                return None
    return None


def recover(path: Path, out: Path) -> int:
    """Copy what can be read of a recording into a new bag that is whole, and return the number of messages.

    Raises:
        RecordingError: there is no recording, or `out` exists.
    """
    files = _files(path)
    with BagWriter(out, config=recorded_config(path)) as bag:
        for file in files:
            with uncompressed(file) as plain:
                if plain.stat().st_size:
                    (_copy_mcap if storage_of(plain) == ".mcap" else _copy_sqlite)(plain, bag)
        return bag.count


def _files(path: Path) -> list[Path]:
    files = storage_files(path)
    for name in missing_files(path):
        log.warning("%s lacks %s, which its metadata.yaml lists: what was recorded there is missing", path, name)
    return files


class _Bounded:
    """A file from which nothing is read that it does not hold: a length inside a damaged record may be any number."""

    def __init__(self, stream: IO[bytes], size: int) -> None:
        self._stream = stream
        self._size = size

    def read(self, length: int) -> bytes:
        """Return at most so many bytes; none for a negative number."""
        left = self._size - self._stream.tell()
        return self._stream.read(max(0, min(length, left)))


def _copy_mcap(file: Path, bag: BagWriter) -> None:
    schemas: dict[int, Schema] = {}
    copies: dict[int, int] = {}
    left_out: set[int] = set()
    for record in _records(file):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel) and record.id not in copies and record.id not in left_out:
            schema = schemas.get(record.schema_id)
            if record.message_encoding != "cdr":
                log.warning(LEFT_OUT, file, record.topic, record.message_encoding)
                left_out.add(record.id)
            elif schema is None:
                log.warning("%s: the topic %s is left out: nothing tells the type of its messages", file, record.topic)
                left_out.add(record.id)
            else:
                text = schema.data.decode("utf-8", "replace")
                copies[record.id] = bag.add_topic(record.topic, schema.name, RELIABLE, text, schema.encoding)
        elif isinstance(record, Message) and record.channel_id in copies:
            copy = copies[record.channel_id]
            bag.write(copy, plain_payload(bytes(record.data)), record.log_time, record.publish_time, record.sequence)


def _copy_sqlite(file: Path, bag: BagWriter) -> None:
    copies: dict[tuple[str, str], int | None] = {}
    for recorded in read_sqlite(file):
        topic = recorded.topic, recorded.kind
        if topic not in copies:
            # Such files need not hold the definitions of their messages.
            known = recorded.kind in typestore().fielddefs
            copies[topic] = bag.add_topic(*topic, RELIABLE) if known else None
            if not known:
                log.warning("%s is left out: the type %s is not known", *topic)
        copy = copies[topic]
        if copy is not None:
            bag.write(copy, recorded.payload, recorded.time)


def _read_mcap(path: Path) -> Iterator[Recorded]:
    kinds: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    for record in _records(path):
        if isinstance(record, Schema):
            kinds[record.id] = record.name
        elif isinstance(record, Channel):
            if record.message_encoding != "cdr" and record.id not in channels:
                log.warning(LEFT_OUT, path, record.topic, record.message_encoding)
            channels[record.id] = record
        elif isinstance(record, Message):
            channel = channels.get(record.channel_id)
            if channel is not None and channel.message_encoding == "cdr":
                kind = kinds.get(channel.schema_id, "")
                yield Recorded(channel.topic, kind, record.log_time, plain_payload(bytes(record.data)))


def _records(path: Path) -> Iterator[Any]:
    """Yield the records of an MCAP file up to its end, or to where it breaks off."""
    with path.open("rb") as stream:
        if stream.read(len(_MAGIC)) != _MAGIC:
            raise RecordingError(f"{path} is not an MCAP file: it does not begin with the MCAP magic bytes")
        while True:
            begin = stream.tell()
            try:
                for record in _stream_reader(stream, path).records:
                    yield from records_in(record, path) if isinstance(record, Chunk) else [record]
                    begin = stream.tell()
                return
            except _DAMAGE as error:
                why = str(error) or "end of file"
            found, following = _around(stream, path, begin)
            yield from found
            if following is None:
                log.warning("%s breaks off near byte %d, the rest is lost: %s", path, begin, why)
                return
            log.warning("%s is damaged near byte %d, a chunk is left out: %s", path, begin, why)
            stream.seek(following)


def _stream_reader(stream: IO[bytes], path: Path) -> StreamReader:
    bounded = _Bounded(stream, path.stat().st_size)
    return StreamReader(cast(IO[bytes], bounded), skip_magic=True, emit_chunks=True, record_size_limit=_LARGEST_RECORD)


def _around(stream: IO[bytes], path: Path, begin: int) -> tuple[list[Any], int | None]:
    """Find what can be read around damage.

    Args:
        stream: of the file.
        path: its path.
        begin: where the damaged record begins.

    Returns:
        The records of a chunk that breaks off with the file, and where reading can go on; None where it cannot.
    """
    stream.seek(begin)
    head = stream.read(_RECORD.size)
    if len(head) < _RECORD.size:
        return [], None
    opcode, length = _RECORD.unpack(head)
    left = path.stat().st_size - stream.tell()
    if opcode != Opcode.CHUNK or length > _LARGEST_RECORD:
        return [], None
    if length > left:
        try:
            return records_before_cut(stream.read(left), path), None
        except _DAMAGE:
            return [], None
    # After a chunk whose length is damaged, too, comes anything but a record.
    stream.seek(length, 1)
    known = stream.read(1) in {bytes([code]) for code in Opcode}
    return [], begin + _RECORD.size + length if known else None
