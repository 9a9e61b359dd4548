"""Bags as `ros2 bag` writes and leaves them: either storage, every compression, killed recorders."""

import shutil
import sqlite3
from contextlib import closing, suppress

import lz4.frame
import mcap.reader
import mcap.writer
import pytest
import zstandard
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.writer import CompressionFormat, CompressionMode

from common.geometry import Pose
from deploy.recording.errors import RecordingError
from deploy.recording.reader import read_bag, recover
from deploy.recording.storage import storage_files
from deploy.recording.writer import BagWriter
from deploy.ros2.conversions import odometry
from deploy.ros2.messages import serialize, typestore
from deploy.ros2.qos import RELIABLE

KIND = "nav_msgs/msg/Odometry"
COUNT = 20


def payload(number):
    return serialize(odometry(1000.0 + 0.1 * number, "odom", "base_link", Pose(0.1 * number, 0.0)), KIND)


PAYLOADS = [payload(number) for number in range(COUNT)]


def write(path, plugin, mode=None):
    writer = Writer(path, version=9, storage_plugin=plugin)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/odom", KIND, typestore=typestore())
        for number, data in enumerate(PAYLOADS):
            writer.write(connection, (number + 1) * 10**8, data)
    return path


def payloads(path):
    return [one.payload for one in read_bag(path)]


@pytest.mark.parametrize("plugin", StoragePlugin)
@pytest.mark.parametrize("mode", [None, CompressionMode.FILE, CompressionMode.MESSAGE])
def test_every_bag_is_read_with_and_without_its_metadata(tmp_path, plugin, mode):
    path = write(tmp_path / "bag", plugin, mode)
    assert payloads(path) == PAYLOADS
    # A recorder that is killed has not written it.
    (path / "metadata.yaml").unlink()
    assert payloads(path) == PAYLOADS
    (file,) = path.iterdir()
    assert payloads(file) == PAYLOADS
    assert recover(path, tmp_path / "whole") == COUNT
    assert payloads(tmp_path / "whole") == PAYLOADS


def test_files_that_somebody_compressed_are_read(tmp_path):
    (file,) = (each for each in write(tmp_path / "bag", StoragePlugin.MCAP).iterdir() if each.suffix == ".mcap")
    data = file.read_bytes()
    (tmp_path / "a.mcap.lz4").write_bytes(lz4.frame.compress(data))
    (tmp_path / "a.mcap.zst").write_bytes(zstandard.compress(data))
    assert payloads(tmp_path / "a.mcap.lz4") == payloads(tmp_path / "a.mcap.zst") == PAYLOADS


def test_a_compressed_file_without_its_end_gives_what_comes_before(tmp_path, caplog):
    (file,) = (each for each in write(tmp_path / "bag", StoragePlugin.MCAP).iterdir() if each.suffix == ".mcap")
    data = file.read_bytes()
    blocks = zstandard.ZstdCompressor().compressobj()
    packed = blocks.compress(data[:9000]) + blocks.flush(zstandard.COMPRESSOBJ_FLUSH_BLOCK)
    (tmp_path / "cut.mcap.zstd").write_bytes(packed)
    (tmp_path / "nothing.mcap.zstd").write_bytes(zstandard.compress(data)[:8])
    assert payloads(tmp_path / "cut.mcap.zstd") == payloads(file)[: len(payloads(tmp_path / "cut.mcap.zstd"))]
    with pytest.raises(RecordingError, match="holds nothing"):
        payloads(tmp_path / "nothing.mcap.zstd")
    assert any("breaks off" in record.message for record in caplog.records)


def test_a_database_whose_writer_was_killed_is_read_and_left_as_it_is(tmp_path):
    path = write(tmp_path / "bag", StoragePlugin.SQLITE3)
    (file,) = path.glob("*.db3")
    living = sqlite3.connect(file)
    living.execute("PRAGMA journal_mode=WAL")
    living.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (1, 1, ?)", (PAYLOADS[0],))
    living.commit()
    # The copy is what lies on the disk when the process is gone: the last message is in the -wal file alone.
    copy = tmp_path / "killed"
    shutil.copytree(path, copy)
    living.close()
    (copy / "metadata.yaml").unlink()
    before = {each.name: each.read_bytes() for each in copy.iterdir()}
    assert any(name.endswith("-wal") for name in before)
    assert payloads(copy) == [*PAYLOADS, PAYLOADS[0]]
    assert {each.name: each.read_bytes() for each in copy.iterdir()} == before


def test_a_damaged_database_is_named(tmp_path):
    (file,) = write(tmp_path / "bag", StoragePlugin.SQLITE3).glob("*.db3")
    file.write_bytes(file.read_bytes()[:5000])
    with pytest.raises(RecordingError, match=r"bag.db3 is no bag of ROS 2: "):
        payloads(file)
    (tmp_path / "ros1.bag").write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(RecordingError, match="name the folder of a ROS 2 bag"):
        payloads(tmp_path / "ros1.bag")


def test_of_a_database_that_breaks_off_the_beginning_is_read(tmp_path, caplog):
    (file,) = write(tmp_path / "bag", StoragePlugin.SQLITE3).glob("*.db3")
    whole, data = payloads(file), file.read_bytes()
    file.write_bytes(data[: len(data) * 3 // 4])
    found = payloads(file)
    assert 0 < len(found) < len(whole) and found == whole[: len(found)]
    assert "breaks off" in caplog.text and ".recover" in caplog.text
    assert len(file.read_bytes()) < len(data), "the recording stays as it is"


def test_a_folder_holds_one_recording(tmp_path):
    """One that was converted in its folder counts once; of several the user chooses."""
    bag = write(tmp_path / "bag", StoragePlugin.SQLITE3)
    (converted,) = write(tmp_path / "other", StoragePlugin.MCAP).glob("*.mcap")
    shutil.copy(converted, bag / "bag.mcap")
    (bag / "._bag.db3").write_bytes(b"\0\5\26\7notes of a file system")
    assert payloads(bag) == PAYLOADS
    (bag / "metadata.yaml").unlink()
    with pytest.raises(RecordingError, match=r"2 recordings \(bag.db3, bag.mcap\), expected those of one: name a file"):
        payloads(bag)
    assert payloads(bag / "bag.mcap") == PAYLOADS
    for name in ("run1.mcap", "run2.mcap"):
        shutil.copy(converted, tmp_path / name)
    with pytest.raises(RecordingError, match="2 recordings"):
        payloads(tmp_path)


@pytest.mark.parametrize("listed", ['  "relative_file_paths": ["bag_0.mcap", "bag_1.mcap"],', None])
def test_a_file_that_was_not_copied_is_named(tmp_path, listed, caplog):
    bag = write(tmp_path / "bag", StoragePlugin.MCAP)
    (bag / "bag.mcap").rename(bag / "bag_0.mcap")
    notes = (bag / "metadata.yaml").read_text()
    listed = listed or notes.replace("- bag.mcap", "- bag_0.mcap\n  - 'bag_1.mcap'")
    (bag / "metadata.yaml").write_text(listed)
    assert payloads(bag) == PAYLOADS
    assert [record.message for record in caplog.records] == [
        f"{bag} lacks bag_1.mcap, which its metadata.yaml lists: what was recorded there is missing"
    ]


def test_rows_that_are_no_messages_cost_no_other(tmp_path, caplog):
    bag = write(tmp_path / "bag", StoragePlugin.SQLITE3)
    with closing(sqlite3.connect(bag / "bag.db3")) as database, database:
        for time, data in ((5, None), (5, "text"), (5, 7), (None, b"x"), ("now", b"x"), (-5, b"x")):
            with suppress(sqlite3.IntegrityError):
                database.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (1, ?, ?)", (time, data))
    assert payloads(bag) == PAYLOADS
    assert "messages are left out, they have no content or no time" in caplog.text
    assert recover(bag, tmp_path / "whole") == COUNT


@pytest.mark.parametrize("encoding", ["ros1", "json"])
def test_messages_of_another_packing_are_left_out_with_a_word(tmp_path, encoding, caplog):
    path = tmp_path / "other.mcap"
    with path.open("wb") as stream:
        writer = mcap.writer.Writer(stream)
        writer.start()
        schema = writer.register_schema(KIND, "ros1msg", b"int32 data")
        writer.add_message(writer.register_channel("/odom", encoding, schema), 1, b"\0\1\0\0data", 1)
        writer.add_message(writer.register_channel("/blank", "cdr", 0), 1, b"\0\1\0\0data", 1)
        writer.finish()
    assert [one.topic for one in read_bag(path)] == ["/blank"]
    assert f"the topic /odom is left out: its messages are packed as '{encoding}', expected cdr" in caplog.text
    # They would become CDR by name only.
    assert recover(path, tmp_path / "whole") == 0
    assert "the topic /blank is left out: nothing tells the type of its messages" in caplog.text


def test_a_definition_keeps_its_language(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        channel = bag.add_topic("/thing", "my_msgs/msg/Thing", RELIABLE, "module my_msgs {};", "ros2idl")
        bag.write(channel, b"\0\1\0\0data", 1)
    recover(tmp_path / "bag", tmp_path / "whole")
    with (tmp_path / "whole" / "whole_0.mcap").open("rb") as stream:
        (schema,) = mcap.reader.make_reader(stream).get_summary().schemas.values()
    assert (schema.encoding, schema.data) == ("ros2idl", b"module my_msgs {};")


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("a.mcap", b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "a.mcap is a pointer of Git LFS"),
        ("a.db3", b"<!DOCTYPE html>", "a.db3 is a web page"),
        ("a.bag", b"#ROSBAG V2.0\n", "name the folder of a ROS 2 bag.*; of a bag of ROS 1 `rosbags-convert"),
        ("a.mcap.zstd", b"plain", "holds nothing that can be unpacked: copy it again, or name it without .zstd"),
    ],
)
def test_what_lies_in_the_place_of_a_recording_is_told(tmp_path, name, data, words):
    (tmp_path / name).write_bytes(data)
    for path in (tmp_path / name, tmp_path):
        with pytest.raises(RecordingError, match=words):
            payloads(path)


def test_files_of_a_split_bag_come_in_the_order_of_their_numbers(tmp_path):
    for name in ("run_10.mcap", "run_9.mcap.zstd", "run_2.mcap", "run_2.mcap.zstd", "notes.txt", "metadata.yaml"):
        (tmp_path / name).write_bytes(b"")
    assert [file.name for file in storage_files(tmp_path)] == ["run_2.mcap", "run_9.mcap.zstd", "run_10.mcap"]
