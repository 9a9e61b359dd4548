import json
import re
import time
from dataclasses import fields
from importlib.resources import files

import numpy as np
import pytest

from common.geometry import Pose, Scan
from common.page.hub import Hub
from common.page.source import Command
from deploy.bridge.command_text import CommandError
from deploy.bridge.status import Status
from deploy.bridge.unseen import Unseen
from deploy.page.feed import RobotFeed, roles_of
from deploy.page.replay import Replay
from deploy.profiles import load_deploy_config
from deploy.recording.errors import RecordingError
from deploy.recording.writer import BagWriter
from deploy.ros2 import RELIABLE, message
from deploy.ros2.conversions import laser_scan, occupancy_grid, odometry, point_cloud
from deploy.ros2.messages import serialize
from tests.common.bus.processes import eventually

STRING = "std_msgs/msg/String"


def config(*overrides, profile="bare"):
    return load_deploy_config(None, list(overrides), profile=profile)


def text(value):
    return serialize(message(STRING, data=value if isinstance(value, str) else json.dumps(value)), STRING, "jazzy")


def watching(hub, *patterns):
    view = hub.join()
    view.watch(patterns)
    return view


def values(hub, view):
    found = {}
    for frame in hub.collect(view):
        if isinstance(frame, str):
            told = json.loads(frame)
            found |= dict.fromkeys(told.get("gone", ())) | told.get("values", {})
    return found


def test_the_newest_counts_and_waits_for_the_name():
    feed, hub = RobotFeed(config()), Hub()
    view = watching(hub, "*")
    odometry_kind = "nav_msgs/msg/Odometry"
    for x in (1.0, 2.0):
        feed.take("odometry", serialize(odometry(1.0, "map", "base_link", Pose(x, 0.0)), odometry_kind, "jazzy"))
    feed.refresh(hub)
    assert values(hub, view) == {}
    feed.take("status", text({"name": "r", "state": "idle", "pose": [9.0, 9.0, 9.0]}))
    feed.refresh(hub)
    found = values(hub, view)
    assert found["robot/r/status"]["state"] == "idle"
    assert found["robot/r/pose"][:3] == [2.0, 0.0, 0.0], "the odometry's, not the status's"


def test_what_waits_is_one_event_and_not_one_for_each_second():
    feed, hub = RobotFeed(config()), Hub()
    reasons = [f"no pose for {seconds / 2:.1f} s (limit 1 s)" for seconds in range(2, 12)]
    for reason in [*reasons, "new target (1.00, 2.00)", "new target (3.00, 2.00)"]:
        feed.take("status", text({"name": "r", "state": "holding", "reason": reason}))
        feed.refresh(hub)
    told = [json.loads(frame) for frame in hub.collect(watching(hub, "*")) if isinstance(frame, str)]
    events = next(frame["series"]["robot/r/events"] for frame in told if "series" in frame)["items"]
    assert [event[2] for event in events] == [reasons[0], "new target (1.00, 2.00)", "new target (3.00, 2.00)"]


def test_the_page_reads_what_the_status_holds():
    script = (files("deploy.page") / "static" / "panels.js").read_text()
    for name, record in (("status", Status), ("unseen", Unseen)):
        read = set(re.findall(rf"\b{name}\??\.(\w+)", script))
        assert read
        assert read <= {field.name for field in fields(record)}


def test_a_scan_is_placed_by_pose_and_lidar_and_only_when_somebody_looks():
    feed, hub = RobotFeed(config("sensing.pose=tf", "sensing.sensor_offset=[1.0, 0.0, 0.0]")), Hub()
    scan = laser_scan(1.0, "laser", Scan(np.array([2.0, 99.0], np.float32), 0.0, 0.1, 10.0, 0.1))
    payload = serialize(scan, "sensor_msgs/msg/LaserScan", "jazzy")
    feed.take("status", text({"name": "r", "pose": [5.0, 5.0, np.pi / 2.0]}))
    feed.take("scan", payload)
    feed.refresh(hub)
    view = watching(hub, "*")
    assert "robot/r/scan" not in values(hub, view)
    feed.take("scan", payload)
    feed.refresh(hub)
    assert values(hub, view)["robot/r/scan"] == [500, 800]


def test_a_cloud_is_placed_by_pose_and_lidar_unless_it_is_in_the_robots_frame():
    overrides = ["sensing.source=points", "topics.points=/cloud", "sensing.points_frame=sensor", "sensing.pose=tf"]
    feed, hub = RobotFeed(config(*overrides, "sensing.sensor_offset=[1.0, 0.0, 0.0]")), Hub()
    view = watching(hub, "*")
    hub.collect(view)
    feed.take("status", text({"name": "r", "pose": [5.0, 5.0, np.pi / 2.0]}))
    feed.refresh(hub)
    for frame, place in (("lidar", [500, 800]), ("base_link", [500, 700])):
        cloud = point_cloud(1.0, frame, np.array([[2.0, 0.0, 0.5], [9.0, 0.0, 5.0]], np.float32))
        feed.take("points", serialize(cloud, "sensor_msgs/msg/PointCloud2", "jazzy"))
        feed.refresh(hub)
        assert values(hub, view)["robot/r/scan"] == place


@pytest.mark.parametrize("step", [-3600.0, 3600.0])
def test_a_robot_falls_silent_whatever_this_machines_clock_does(monkeypatch, step):
    feed = RobotFeed(config())
    feed.take("status", text({"name": "r"}))
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now + step)
    assert 0.0 <= feed.age < 60.0
    later = time.monotonic_ns() + 10**11
    monkeypatch.setattr(time, "monotonic_ns", lambda: later)
    assert 100.0 <= feed.age < 160.0


@pytest.mark.parametrize(
    "bad",
    [b"", b"\x00\x01\x00\x00\xff\xff\xff\xff", text("no JSON"), text([1]), text('{"a": 1e999}'), text("[" * 99)],
)
def test_nonsense_on_a_topic_spoils_nothing_else(bad, caplog):
    feed, hub = RobotFeed(config()), Hub()
    view = watching(hub, "*")
    for _ in range(3):
        for role in ("scene", "watchdog", "belief", "path", "scan", "odometry", "runtime"):
            feed.take(role, bad)
        feed.take("status", text({"name": "r", "state": "running"}))
        feed.refresh(hub)
    assert values(hub, view) == {"robot/r/status": {"name": "r", "state": "running"}}
    assert len([line for line in caplog.messages if "scene" in line]) == 1, "once, and not with every message"


def test_every_profile_has_what_the_page_needs():
    for profile in ("bare", "cmu", "nav2"):
        found = roles_of(config(profile=profile))
        assert {"status", "watchdog", "scene", "belief", "path", "runtime"} <= set(found)
        assert len({topic for topic, _, _ in found.values()}) == len(found)


@pytest.fixture
def recording(tmp_path):
    """Three seconds: the robot drives from x 0 to 3, and the belief grows with it; the bridge speaks from 0.5 on."""
    with BagWriter(tmp_path / "bag", config=config()) as bag:
        kinds = {"/hd/status": STRING, "/odom": "nav_msgs/msg/Odometry", "/hd/belief": "nav_msgs/msg/OccupancyGrid"}
        channels = {topic: bag.add_topic(topic, kind, RELIABLE) for topic, kind in kinds.items()}
        for tick in range(31):
            at, x = 1_700_000_000_000_000_000 + tick * 100_000_000, tick / 10.0
            cells = np.full((10, 40), -1, np.int8)
            cells[:, : tick + 1] = 0
            said = {
                "/hd/status": message(STRING, data=json.dumps({"name": "r", "state": "running", "distance": x})),
                "/odom": odometry(at * 1e-9, "map", "base_link", Pose(x, 0.0)),
                "/hd/belief": occupancy_grid(at * 1e-9, "map", cells, 0.1, (0.0, 0.0)),
            }
            for topic, what in said.items():
                if topic == "/odom" or tick >= 5:
                    bag.write(channels[topic], serialize(what, kinds[topic], "jazzy"), at)
    return tmp_path / "bag"


def ask(replay, verb, **arguments):
    return replay.carry_out(Command("", verb, arguments, "test"))


def test_a_recording_goes_where_it_is_sent(recording):
    hub = Hub()
    view = watching(hub, "*")
    with Replay(recording, config()) as replay:
        seen = {}

        def until(condition):
            def look():
                replay.refresh(hub)
                seen.update(values(hub, view))
                return condition()

            assert eventually(look)

        def driven():
            return (seen.get("robot/r/status") or {}).get("distance")

        ask(replay, "pause")
        ask(replay, "seek", position=2.0)
        until(lambda: driven() == 2.0)
        ask(replay, "seek", position=0.5)
        until(lambda: driven() == 0.5 and seen["robot/r/pose"] and seen["robot/r/pose"][0] == 0.5)
        assert seen["replay"]["length"] == 3.0
        ask(replay, "seek", position=0.2)
        until(lambda: seen["robot/r/status"] is None and seen["replay"]["position"] == 0.2)
        ask(replay, "speed", factor=100.0)
        ask(replay, "play")
        until(lambda: driven() == 3.0 and not seen["replay"]["playing"])
        with pytest.raises(CommandError, match="number 'position'"):
            ask(replay, "seek", position="late")
    with pytest.raises(RecordingError, match="no message of /other"):
        Replay(recording, config("topics.status=/other"))
