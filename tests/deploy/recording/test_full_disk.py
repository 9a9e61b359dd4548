"""A disk that fills up under a recording: it is said once, and what was recorded before can be read."""

import random
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from deploy.recording.errors import RecordingError
from deploy.recording.reader import read_bag, recover
from deploy.recording.writer import BagWriter
from deploy.ros2 import RELIABLE, Node, message
from deploy.ros2.messages import serialize
from tests.common.bus.processes import eventually
from tests.deploy.ros2.network import rmw_router, ros
from tests.rigs.disk import MountRefusedError, mounted

ROOT = Path(__file__).parents[3]
STRING = "std_msgs/msg/String"


@pytest.fixture
def small_disk(tmp_path):
    try:
        with mounted(tmp_path / "disk", 4) as disk:
            yield disk
    except MountRefusedError as error:
        pytest.skip(str(error))


def words(number):
    # Random, so that packing does not make it small.
    return message(STRING, data=f"{number} {random.Random(number).randbytes(5000).hex()}")


def numbers(bag):
    return [int(recorded.payload[8:20].split(b" ")[0]) for recorded in read_bag(bag)]


@pytest.mark.parametrize("compression", ["none", "zstd"])
def test_what_was_flushed_can_be_read(small_disk, tmp_path, compression):
    path = small_disk.path / "bag"
    with pytest.raises(RecordingError, match="No space left on device; make room"), BagWriter(path) as bag:
        channel = bag.add_topic("/words", STRING, RELIABLE)
        for number in range(10):
            bag.write(channel, serialize(words(number), STRING), 1 + number)
        bag.flush()
        small_disk.fill(leave=5_000)
        for number in range(10, 1000):
            bag.write(channel, serialize(words(number), STRING), 1 + number)
    bag.write(channel, b"", 1)
    bag.close()
    assert sorted(file.name for file in path.iterdir()) == ["bag_0.mcap", "metadata.yaml"]
    assert numbers(path) == list(range(10))
    assert recover(path, tmp_path / "whole") == 10
    assert numbers(tmp_path / "whole") == list(range(10))


def test_a_bag_that_cannot_be_begun_leaves_nothing(small_disk):
    small_disk.fill()
    path = small_disk.path / "bag"
    with pytest.raises(RecordingError, match="No space left on device"):
        BagWriter(path)
    small_disk.empty()
    BagWriter(path).close()


def test_an_index_without_room_leaves_the_messages(small_disk):
    path = small_disk.path / "bag"
    bag = BagWriter(path)
    channel = bag.add_topic("/words", STRING, RELIABLE)
    bag.write(channel, serialize(words(7), STRING), 1)
    bag.flush()
    small_disk.fill()
    with pytest.raises(RecordingError, match="Earlier data is readable"):
        bag.close()
    bag.close()
    assert numbers(path) == [7]


@pytest.mark.timeout(200)
def test_the_command_says_it_in_one_line_and_leaves_a_readable_bag(small_disk):
    done = threading.Event()

    def publish(node):
        publisher = node.publisher("/words", STRING)
        number = 0
        while not done.wait(0.02):
            publisher.publish(words(number))
            number += 1

    path = small_disk.path / "bag"
    with rmw_router() as endpoint, Node(ros(endpoint), "speaker") as node:
        speaker = threading.Thread(target=publish, args=(node,))
        speaker.start()
        command = [sys.executable, "-m", "deploy", "record", "--out", str(path), "--connect", endpoint]
        try:
            with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as process:
                try:
                    assert eventually(
                        lambda: (path / "metadata.yaml").exists() and len(list(read_bag(path))) > 10, 100.0
                    )
                    small_disk.fill(leave=20_000)
                    _, errors = process.communicate(timeout=60)
                finally:
                    process.kill()
        finally:
            done.set()
            speaker.join()
    assert process.returncode == 1
    assert errors.count("No space left on device; make room") == 1 and "Traceback" not in errors
    small_disk.empty()
    assert len(numbers(path)) > 10
