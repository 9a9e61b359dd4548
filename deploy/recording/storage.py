"""The storage files of a bag: which they are, in what order, and what is in them without its compression."""

from __future__ import annotations

import logging
import os
import re
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Final, cast

import lz4.frame
import zstandard

from common.system.documents import DocumentError, read_text
from common.system.paths import exists, is_file
from common.system.stand_ins import stand_in
from deploy.recording.errors import RecordingError

log = logging.getLogger(__name__)

LEFT_OUT: Final = "%s: the topic %s is left out: its messages are packed as %r, expected cdr, as in ROS 2"
"""Warning about a file's topic, with the packing."""
STORAGES: Final = (".mcap", ".db3")
_COMPRESSIONS: Final = (".zstd", ".zst", ".lz4")
# A CDR payload begins with a zero, so that the first bytes of compressed data cannot be taken for one.
_ZSTD: Final = b"\x28\xb5\x2f\xfd"
_LZ4: Final = b"\x04\x22\x4d\x18"
_BLOCK: Final = 1 << 20
_ROS_1: Final = "; of a bag of ROS 1 `rosbags-convert --src FILE.bag --dst FOLDER` makes one"
# Files in `metadata.yaml`, one a line as others write them, or in brackets as we do.
_LIST: Final = re.compile(r"""relative_file_paths["']?\s*:\s*(\[[^\]]*\]|(?:-[ \t][^\n]*\n?[ \t]*)+)""")
_LISTED: Final = re.compile(r"""[^\s\[\],"'-][^\n,\]"']*""")


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


def storage_files(path: Path) -> list[Path]:
    """Return the files of a bag in their order.

    Its `metadata.yaml`, which a recorder writes last, is needed only where a folder holds the files of several.

    Args:
        path: folder of a bag, or one of its files: `.mcap` or `.db3`, perhaps compressed (`.zstd`, `.zst`, `.lz4`).

    Raises:
        RecordingError: there is none, there are several, or something else lies in the place of one.
    """
    if is_file(path):
        if not storage_of(path):
            hint = _ROS_1 if path.suffix == ".bag" else ""
            raise RecordingError(
                f"{path} is no recording: name the folder of a ROS 2 bag, or its .mcap or .db3 file{hint}"
            )
        files = [path]
    elif exists(path) and path.is_dir():
        files = sorted(_of_one_bag(path), key=_by_number)
    else:
        raise RecordingError(f"no recording at {path}: give the folder of a bag, or an .mcap or .db3 file")
    for file in files:
        with file.open("rb") as stream:
            if instead := stand_in(stream.read(1024)):
                raise RecordingError(f"{file} {instead}")
    return files


def missing_files(path: Path) -> list[str]:
    """Return the names of the files that the `metadata.yaml` of a bag lists and that are not in its folder."""
    there = {_plain_name(file) for file in storage_files(path)}
    return [] if path.is_file() else [name for name in _listed(path) if _plain_name(Path(name)) not in there]


def _of_one_bag(folder: Path) -> list[Path]:
    """Return the storage files of the only bag in a folder, or of that which its `metadata.yaml` lists."""
    # Hidden ones are notes of a file system, such as the ._NAME of a stick that was in a Mac.
    found = [file for file in folder.iterdir() if not file.name.startswith(".") and storage_of(file) and is_file(file)]
    # A file that was compressed may still lie beside its compressed form.
    plain = {file.name for file in found}
    found = [file for file in found if file.suffix not in _COMPRESSIONS or file.stem not in plain]
    if not found:
        hint = _ROS_1 if any(folder.glob("*.bag")) else ""
        raise RecordingError(f"{folder} holds no .mcap and no .db3 file: name the folder of a ROS 2 bag{hint}")
    bags: dict[tuple[str, str], list[Path]] = {}
    for file in sorted(found):
        name = _plain_name(file).removesuffix(storage_of(file))
        # `ros2 bag` numbers the files of one recording so: NAME_0, NAME_1.
        bags.setdefault((re.sub(r"_[0-9]+$", "", name), storage_of(file)), []).append(file)
    if len(bags) > 1:
        listed = {_plain_name(Path(name)) for name in _listed(folder)}
        chosen = {key: files for key, files in bags.items() if any(_plain_name(file) in listed for file in files)}
        if not chosen:
            names = ", ".join(files[0].name for files in bags.values())
            raise RecordingError(
                f"{folder} holds the files of {len(bags)} recordings ({names}), expected those of one: name a file, or "
                "put each into a folder of its own"
            )
        bags = chosen
    return [file for files in bags.values() for file in files]


def _listed(folder: Path) -> list[str]:
    """Return the files that the `metadata.yaml` of a bag lists; none where it cannot be read."""
    try:
        text = read_text(folder / "metadata.yaml")
    except (OSError, DocumentError):
        return []
    found = _LIST.search(text)
    return [] if found is None else [Path(name.strip()).name for name in _LISTED.findall(found[1])]


def _plain_name(file: Path) -> str:
    return file.stem if file.suffix in _COMPRESSIONS else file.name


def storage_of(file: Path) -> str:
    """Return `.mcap` or `.db3` by a file's name, compressed or not; empty for any other."""
    suffix = Path(file.stem).suffix if file.suffix in _COMPRESSIONS else file.suffix
    return suffix if suffix in STORAGES else ""


@contextmanager
def uncompressed(file: Path) -> Iterator[Path]:
    """Give a storage file as it was before it was compressed, for the time of a `with`.

    A file whose end is missing gives what comes before.
    """
    if file.suffix not in _COMPRESSIONS:
        yield file
        return
    with tempfile.TemporaryDirectory(prefix="hd-bag-") as folder:
        plain = Path(folder) / file.stem
        with file.open("rb") as packed, plain.open("wb") as out:
            stream: IO[bytes]
            if file.suffix == ".lz4":
                stream = cast(IO[bytes], lz4.frame.LZ4FrameFile(packed))
            else:
                stream = cast(IO[bytes], zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True))
            try:
                while block := stream.read(_BLOCK):
                    out.write(block)
            except (zstandard.ZstdError, RuntimeError, EOFError) as error:
                # RuntimeError is what LZ4 raises.
                log.warning("%s breaks off, the rest is lost: %s", file, error)
        yield plain


def plain_payload(payload: bytes) -> bytes:
    """Return a message without the compression that `ros2 bag record --compression-mode message` gives each of them.

    One that is damaged is returned as it is: then it is no CDR, and counts as a message that cannot be read.
    """
    if payload[:4] not in {_ZSTD, _LZ4}:
        return payload
    try:
        if payload[:4] == _LZ4:
            return bytes(lz4.frame.decompress(payload))
        # The size may be missing in the frame's header.
        return zstandard.ZstdDecompressor().decompressobj().decompress(payload)
    except (zstandard.ZstdError, RuntimeError) as error:
        log.warning("a compressed message of %d bytes cannot be read: %s", len(payload), error)
        return payload


def read_sqlite(file: Path) -> Iterator[Recorded]:
    """Yield the messages of a `.db3` file in their order, up to its end or to where it is damaged.

    Raises:
        RecordingError: it is no such file.
    """
    with _opened(file) as database:
        try:
            columns = {row[1] for row in database.execute("PRAGMA table_info(topics)")}
            formats = "serialization_format" if "serialization_format" in columns else "'cdr'"
            topics: dict[int, tuple[str, str]] = {}
            for number, name, kind, form in database.execute(f"SELECT id, name, type, {formats} FROM topics"):
                if form == "cdr":
                    topics[number] = name, kind
                else:
                    log.warning(LEFT_OUT, file, name, form)
            rows = database.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id")
        except sqlite3.Error as error:
            raise RecordingError(f"{file} is no bag of ROS 2: {error}") from None
        unusable = 0
        while True:
            try:
                row: tuple[Any, Any, Any] | None = next(rows, None)
            except sqlite3.Error as error:
                log.warning("%s is damaged, the rest is lost: %s", file, error)
                break
            if row is None:
                break
            number, time, data = row
            # A column of SQLite holds whatever was put into it.
            if not (isinstance(time, int) and time >= 0 and isinstance(data, bytes)):
                unusable += 1
            elif number in topics:
                yield Recorded(*topics[number], time, plain_payload(data))
        if unusable:
            log.warning("%s: %d messages are left out, they have no content or no time since 1970", file, unusable)


@contextmanager
def _opened(file: Path) -> Iterator[sqlite3.Connection]:
    """Open a database, also one whose writer was killed in the middle of a transaction."""
    journals = [other for other in file.parent.glob(f"{file.name}-*") if other.stat().st_size]
    with tempfile.TemporaryDirectory(prefix="hd-bag-") as folder:
        place = file
        if journals:
            # What the journal holds has to be brought in or rolled back, which must not change the recording.
            place = Path(folder) / file.name
            for each in (file, *journals):
                (Path(folder) / each.name).write_bytes(each.read_bytes())
        elif (size := _told_size(file)) > file.stat().st_size:
            # SQLite reads nothing of a file that is shorter than its header says; where pages of zeros begin, it stops.
            log.warning(
                "%s breaks off, %d of %d bytes are there: what precedes the break is read, `sqlite3 %s .recover` may "
                "find more",
                *(file, file.stat().st_size, size, file.name),
            )
            place = Path(folder) / file.name
            shutil.copyfile(file, place)
            os.truncate(place, size)
        mode = "rw" if journals else "ro"
        try:
            database = sqlite3.connect(f"{place.resolve().as_uri()}?mode={mode}", uri=True)
        except sqlite3.Error as error:
            raise RecordingError(f"cannot open {file}: {error}: check its permissions") from None
        with closing(database):
            yield database


def _told_size(file: Path) -> int:
    """Return the bytes that a database has by its header, 0 where that does not tell."""
    with file.open("rb") as stream:
        head = stream.read(100)
    # The number of pages is valid where both counters of changes agree.
    if len(head) < 100 or not head.startswith(b"SQLite format 3\0") or head[24:28] != head[92:96]:
        return 0
    page = int.from_bytes(head[16:18], "big")
    return (65_536 if page == 1 else page) * int.from_bytes(head[28:32], "big")


def _by_number(file: Path) -> tuple[str, int]:
    """Storage files end in a number, which is no text: _10 comes after _9."""
    name = file.name.removesuffix(file.suffix) if file.suffix in _COMPRESSIONS else file.name
    name = name.removesuffix(storage_of(file))
    found = re.fullmatch(r"(.*?)([0-9]*)", name)
    assert found is not None
    return found[1], int(found[2] or -1)
