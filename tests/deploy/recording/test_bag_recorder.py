import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from common.geometry import Pose
from deploy.config import DeployConfig
from deploy.recording.bag_recorder import BagRecorder
from deploy.recording.reader import read_bag, recorded_config
from deploy.recording.writer import BagWriter
from deploy.ros2 import LATCHED, SENSOR, Node, message
from deploy.ros2.conversions import grid_from, occupancy_grid, odometry, twist
from deploy.ros2.messages import deserialize, serialize
from tests.common.bus.processes import eventually
from tests.deploy.ros2.network import rmw_router, ros

ROOT = Path(__file__).parents[3]
STRING = "std_msgs/msg/String"
LAYOUTS = pytest.mark.parametrize("layout", ["rmw_zenoh", "ros2dds"])


@pytest.fixture(scope="module")
def endpoint():
    with rmw_router() as address:
        yield address


def text(words):
    return message(STRING, data=words)


class Running:
    """A recorder in a thread of its own, as the command runs it."""

    def __init__(self, path, config, **settings):
        self.bag = BagWriter(path, config=config)
        self.recorder = BagRecorder(config.ros, self.bag, **settings)
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self.recorder.run, args=(self.stop,))

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.stop.set()
        self.thread.join(10.0)
        self.recorder.close()
        self.bag.close()

    def counts(self):
        return {topic.name: topic.count for topic in self.bag.topics.values()}


def test_a_clock_that_is_set_meanwhile_does_not_tear_the_recording_apart(endpoint, tmp_path, monkeypatch):
    config = DeployConfig(ros=ros(endpoint))
    with Node(config.ros, "robot") as robot, Running(tmp_path / "lab", config) as running:
        words = robot.publisher("/words", STRING)

        def recorded(count):
            words.publish(text("hello"))
            return running.counts().get("/words", 0) >= count

        assert eventually(lambda: recorded(3))
        clock = time.time_ns
        monkeypatch.setattr(time, "time_ns", lambda: clock() - 3600 * 10**9)
        before = running.counts()["/words"]
        assert eventually(lambda: recorded(before + 3))
    times = [one.time for one in read_bag(tmp_path / "lab")]
    assert times == sorted(times)
    assert times[-1] - times[0] < 300e9


@LAYOUTS
def test_everything_is_recorded_also_what_comes_later(endpoint, layout, tmp_path):
    config = DeployConfig(ros=ros(endpoint, layout=layout))
    with Node(config.ros, "robot") as robot, Running(tmp_path / "lab", config) as running:
        cells = np.arange(6, dtype=np.int8).reshape(2, 3)
        robot.publisher("/map", "nav_msgs/msg/OccupancyGrid", LATCHED).publish(occupancy_grid(1.0, "map", cells, 0.1))
        odometries = robot.publisher("/odom", "nav_msgs/msg/Odometry", SENSOR)
        # A bridge offers an action, whose topics have no message type.
        robot.publisher("/navigate/_action/feedback", "nav2_msgs/action/NavigateToPose_FeedbackMessage")
        robot.publisher("/navigate/feedback", "nav2_msgs/action/NavigateToPose_FeedbackMessage")

        def first():
            odometries.publish(odometry(1.0, "odom", "base", Pose(1.0, 2.0)))
            return running.counts().get("/odom", 0) >= 5 and running.counts().get("/map", 0)

        assert eventually(first)
        velocity = robot.publisher("/cmd_vel", "geometry_msgs/msg/Twist")

        def second():
            velocity.publish(twist(0.5, 0.25))
            return running.counts().get("/cmd_vel", 0) >= 5

        assert eventually(second)
    found = list(read_bag(tmp_path / "lab"))
    assert {one.topic for one in found} == {"/map", "/odom", "/cmd_vel"}
    (grid,) = [one for one in found if one.topic == "/map"]
    assert np.array_equal(grid_from(deserialize(grid.payload, grid.kind))[0], cells)
    command = next(one for one in found if one.topic == "/cmd_vel")
    assert command.payload == serialize(twist(0.5, 0.25), "geometry_msgs/msg/Twist")
    assert abs(command.time * 1e-9 - time.time()) < 60.0


def test_patterns_choose_topics(endpoint, tmp_path):
    config = DeployConfig(ros=ros(endpoint))
    heard = []
    with (
        Node(config.ros, "robot") as robot,
        Running(
            tmp_path / "some",
            config,
            topics=["/hd/*"],
            exclude=["*/image*"],
            listener=lambda topic, kind, payload, arrival: heard.append((topic, kind)),
        ) as running,
    ):
        publishers = [robot.publisher(name, STRING) for name in ("/hd/status", "/hd/image_raw", "/chatter")]

        def said():
            for publisher in publishers:
                publisher.publish(text("hello"))
            return running.counts().get("/hd/status", 0) >= 3

        assert eventually(said)
    assert set(running.counts()) == {"/hd/status"}
    assert set(heard) == {("/hd/status", STRING)}


def test_a_recorder_ends_after_its_duration(endpoint, tmp_path):
    config = DeployConfig(ros=ros(endpoint))
    with BagWriter(tmp_path / "short") as bag, BagRecorder(config.ros, bag) as recorder:
        begin = time.monotonic()
        recorder.run(threading.Event(), 0.5)
        assert 0.4 < time.monotonic() - begin < 10.0


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_the_command_ends_with_a_whole_bag(endpoint, tmp_path, ending):
    folder = tmp_path / "lab"
    code = "from deploy.cli import app; app()"
    command = [sys.executable, "-c", code, "record", "/chatter", "--out", str(folder), "--connect", endpoint]
    command += ["--set", "decision.planner=tare"]
    with (
        Node(ros(endpoint), "robot") as robot,
        subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process,
    ):
        try:
            chatter = robot.publisher("/chatter", STRING)

            def written():
                chatter.publish(text("hello"))
                notes = folder / "metadata.yaml"
                return notes.exists() and '"message_count": 0' not in notes.read_text()

            assert eventually(written, 60.0)
            process.send_signal(ending)
            output, errors = process.communicate(timeout=30.0)
        finally:
            process.kill()
    assert process.returncode == 0, errors
    assert "messages on 1 topics" in output
    with AnyReader([folder]) as reader:
        assert reader.message_count == len(list(read_bag(folder))) > 0
    assert recorded_config(folder).decision.planner == "tare"
