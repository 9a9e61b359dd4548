import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer

from common.geometry import Scan
from deploy.recording.errors import RecordingError
from deploy.recording.reader import read_bag, recorded_config, recover
from deploy.recording.writer import BagWriter
from deploy.ros2 import LATCHED, RELIABLE, SENSOR
from deploy.ros2.conversions import laser_scan, occupancy_grid, point_stamped
from deploy.ros2.markers import markers, spheres
from deploy.ros2.messages import message, serialize, typestore
from tests.deploy.recording.world import config
from tests.deploy.ros2.network import KINDS

ROOT = Path(__file__).parents[3]
SCAN = "sensor_msgs/msg/LaserScan"
POINT = "geometry_msgs/msg/PointStamped"
SECOND = 1_000_000_000


def scan_bytes(number: int) -> bytes:
    ranges = np.full(360, float(number + 1), np.float32)
    return serialize(laser_scan(float(number), "laser", Scan(ranges, 0.0, 0.0175, 2000.0)), SCAN)


@pytest.fixture(params=["none", "lz4", "zstd"])
def bag(request, tmp_path):
    path = tmp_path / "lab"
    with BagWriter(path, "jazzy", request.param, config("decision.planner=tare")) as writer:
        scans = writer.add_topic("/scan", SCAN, SENSOR)
        points = writer.add_topic("/way_point", POINT, RELIABLE)
        for number in range(50):
            writer.write(scans, scan_bytes(number), (100 + number) * SECOND, sequence=number)
        writer.write(points, serialize(point_stamped(1.0, "map", (3.0, 4.0)), POINT), 120 * SECOND, 119 * SECOND)
    return path


def test_foxglove_reads_it(bag):
    """Foxglove's own reader and decoder: profile, schemas, index, statistics."""
    with (bag / "lab_0.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary.statistics.message_count == 51
        assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
        assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
        decoded = [(channel.topic, value) for _, channel, _, value in reader.iter_decoded_messages()]
        scans = [value for topic, value in decoded if topic == "/scan"]
        assert [round(scan.ranges[0]) for scan in scans] == list(range(1, 51))
        (point,) = [value for topic, value in decoded if topic == "/way_point"]
        assert (point.point.x, point.header.frame_id) == (3.0, "map")
        (message,) = [m for _, _, m in reader.iter_messages(topics=["/way_point"])]
        assert (message.log_time, message.publish_time) == (120 * SECOND, 119 * SECOND)


def test_rosbags_reads_it_as_a_ros_bag(bag):
    with AnyReader([bag]) as reader:
        assert reader.message_count == 51
        assert {(one.topic, one.msgtype, one.msgcount) for one in reader.connections} == {
            ("/scan", SCAN, 50),
            ("/way_point", POINT, 1),
        }
        (scan, *_) = [one for one in reader.connections if one.topic == "/scan"]
        assert scan.ext.offered_qos_profiles[0].reliability.name == "BEST_EFFORT"
        values = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages()]
        assert len(values) == 51


def test_we_read_it(bag):
    messages = list(read_bag(bag))
    assert [one.payload for one in messages if one.topic == "/scan"] == [scan_bytes(number) for number in range(50)]
    assert list(read_bag(bag / "lab_0.mcap")) == messages
    assert recorded_config(bag).decision.planner == "tare"


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_we_read_bags_of_others(tmp_path, storage):
    path = tmp_path / "theirs"
    with Writer(path, version=9, storage_plugin=storage) as writer:
        connection = writer.add_connection("/scan", SCAN, typestore=typestore())
        for number in range(5):
            writer.write(connection, (number + 1) * SECOND, scan_bytes(number))
    found = list(read_bag(path))
    assert [(one.topic, one.kind, one.time) for one in found] == [("/scan", SCAN, n * SECOND) for n in range(1, 6)]
    assert [one.payload for one in found] == [scan_bytes(number) for number in range(5)]
    assert recorded_config(path) is None


def test_every_type_has_a_definition_that_others_parse(tmp_path):
    path = tmp_path / "all"
    with BagWriter(path) as writer:
        for number, kind in enumerate(KINDS):
            channel = writer.add_topic(f"/topic{number}", kind, RELIABLE)
            writer.write(channel, serialize(message(kind), kind), SECOND)
        scene = markers([spheres(1.0, "map", "nodes", np.ones((3, 2)), 0.1, (1.0, 0.0, 0.0, 1.0))])
        kind = "visualization_msgs/msg/MarkerArray"
        writer.write(writer.add_topic("/scene", kind, RELIABLE), serialize(scene, kind), SECOND)
    with (path / "all_0.mcap").open("rb") as stream:
        decoded = list(make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages())
    assert len(decoded) == len(KINDS) + 1
    with AnyReader([path]) as reader:
        assert len([reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages()]) == len(KINDS) + 1


@pytest.mark.parametrize("distro", ["humble", "jazzy", "kilted"])
def test_metadata_suits_the_distribution(tmp_path, distro):
    path = tmp_path / "map"
    kind = "nav_msgs/msg/OccupancyGrid"
    with BagWriter(path, distro) as writer:
        grid = serialize(occupancy_grid(1.0, "map", np.zeros((2, 3), np.int8), 0.1), kind, distro)
        writer.write(writer.add_topic("/map", kind, LATCHED), grid, SECOND)
    information = json.loads((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert information["version"] == (5 if distro == "humble" else 9)
    with AnyReader([path]) as reader:
        (connection,) = reader.connections
        assert connection.ext.offered_qos_profiles[0].durability.name == "TRANSIENT_LOCAL"


def test_nothing_is_overwritten(tmp_path):
    (tmp_path / "taken").mkdir()
    with pytest.raises(RecordingError, match="choose another"):
        BagWriter(tmp_path / "taken")


RECORDER = """
import sys, time
from pathlib import Path
from deploy.recording.writer import BagWriter
from deploy.ros2 import SENSOR
from tests.deploy.recording.test_writer import SCAN, SECOND, scan_bytes
bag = BagWriter(Path(sys.argv[1]))
channel = bag.add_topic("/scan", SCAN, SENSOR)
for number in range(40):
    bag.write(channel, scan_bytes(number), number * SECOND + SECOND)
bag.flush()
for number in range(40, 45):
    bag.write(channel, scan_bytes(number), number * SECOND + SECOND)
print("flushed", flush=True)
time.sleep(60)
"""


def test_a_killed_recorder_leaves_what_it_had_flushed(tmp_path, caplog):
    path = tmp_path / "crash"
    with subprocess.Popen([sys.executable, "-c", RECORDER, str(path)], cwd=ROOT, stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"flushed\n"
        process.send_signal(signal.SIGKILL)
    messages = list(read_bag(path))
    assert [one.payload for one in messages] == [scan_bytes(number) for number in range(40)]
    assert any("breaks off" in record.message for record in caplog.records)
    assert recover(path, tmp_path / "whole") == 40
    with AnyReader([tmp_path / "whole"]) as reader:
        assert reader.message_count == 40
    with (tmp_path / "whole" / "whole_0.mcap").open("rb") as stream:
        assert make_reader(stream).get_summary().statistics.message_count == 40


def test_files_cut_or_damaged_anywhere_give_what_is_whole(bag, tmp_path):
    data = (bag / "lab_0.mcap").read_bytes()
    whole = [one.payload for one in read_bag(bag)]
    damaged = tmp_path / "damaged.mcap"
    random = np.random.default_rng(5)
    for cut in [8, 9, 30, *random.integers(10, len(data), 25)]:
        damaged.write_bytes(data[:cut])
        found = [one.payload for one in read_bag(damaged)]
        assert found == whole[: len(found)]
    for _ in range(25):
        noisy = bytearray(data)
        noisy[int(random.integers(8, len(data)))] ^= 0xFF
        damaged.write_bytes(noisy)
        assert len(list(read_bag(damaged))) <= len(whole)


def test_what_is_no_recording_is_refused(tmp_path):
    with pytest.raises(RecordingError, match="no recording at"):
        list(read_bag(tmp_path / "nowhere"))
    (tmp_path / "text.mcap").write_text("hello, this is no recording")
    with pytest.raises(RecordingError, match="not an MCAP file"):
        list(read_bag(tmp_path / "text.mcap"))
    (tmp_path / "empty").mkdir()
    with pytest.raises(RecordingError, match="holds no .mcap and no .db3 file"):
        list(read_bag(tmp_path / "empty"))
    with pytest.raises(RecordingError, match="holds no .mcap and no .db3 file"):
        recover(tmp_path / "empty", tmp_path / "out")
