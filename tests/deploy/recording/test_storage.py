"""Bags as `ros2 bag` writes and leaves them: either storage, every compression, killed recorders."""

import shutil
import sqlite3

import lz4.frame
import pytest
import zstandard
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.writer import CompressionFormat, CompressionMode

from common.geometry import Pose
from deploy.recording.errors import RecordingError
from deploy.recording.reader import read_bag, recover
from deploy.recording.storage import storage_files
from deploy.ros2.conversions import odometry
from deploy.ros2.messages import serialize, typestore

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


def test_files_of_a_split_bag_come_in_the_order_of_their_numbers(tmp_path):
    for name in ("run_10.mcap", "run_9.mcap.zstd", "run_2.mcap", "run_2.mcap.zstd", "notes.txt", "metadata.yaml"):
        (tmp_path / name).write_bytes(b"")
    assert [file.name for file in storage_files(tmp_path)] == ["run_2.mcap", "run_9.mcap.zstd", "run_10.mcap"]
