from dataclasses import replace

import numpy as np
import pytest

from common.geometry import Pose, Scan
from deploy.recording.checks import Checks, histogram
from deploy.recording.reader import Recorded
from deploy.ros2 import message
from deploy.ros2.conversions import laser_scan, occupancy_grid, odometry, point_cloud, transform, transform_message
from tests.deploy.recording.world import BEGIN, ODOMETRY, SCAN, config, recorded

GRID = "nav_msgs/msg/OccupancyGrid"


def pose(seconds, frame="map", stamp=None):
    time = BEGIN + (seconds if stamp is None else stamp)
    return recorded("/odom", ODOMETRY, seconds, odometry(time, frame, "base_link", Pose(0.0, 0.0), (0.8, 0.0)))


def scan(seconds, ranges=(1.0, 2.0, np.nan, 0.05, np.inf), frame="laser"):
    value = Scan(np.array(ranges, np.float32), 0.0, 0.1, 10.0, 0.1)
    return recorded("/scan", SCAN, seconds, laser_scan(BEGIN + seconds, frame, value))


def look(*messages, settings=None) -> Checks:
    checks = Checks(settings or config())
    for one in sorted(messages, key=lambda one: one.time):
        checks.add(one)
    return checks


def good(seconds=3.0):
    return [make(tick * 0.1) for tick in range(round(seconds * 10)) for make in (pose, scan)]


def test_a_sound_recording_has_no_warnings():
    checks = look(*good())
    assert checks.warnings() == []
    assert checks.topics["/odom"].rate == pytest.approx(10.0, abs=0.01)
    assert checks.topics["/odom"].gap == pytest.approx(0.1, abs=1e-5)
    assert checks.duration == pytest.approx(2.9, abs=1e-5)
    assert checks.topics["/odom"].notes() == "up to 0.80 m/s"
    assert checks.topics["/scan"].notes() == "5 beams, 40 % returns, 20 % NaN, 20 % below range_min"


def test_missing_topics_are_named():
    (warning,) = look(*[pose(tick * 0.1) for tick in range(30)]).warnings()
    assert "no message on /scan" in warning
    assert "/odom" in warning
    assert any("no message on /tf" in one for one in look(*good(), settings=config("sensing.pose=tf")).warnings())


def test_topics_of_another_name_are_named_by_their_type():
    """Two robots in one recording, and many topics of no use."""
    named = [replace(one, topic=f"/robot{number}{one.topic}") for number in (1, 2) for one in good()]
    others = [
        recorded(f"/camera{number}", "std_msgs/msg/String", 0.0, message("std_msgs/msg/String")) for number in range(30)
    ]
    first, second = look(*named, *others).warnings()
    assert "LaserScan is there on /robot1/scan, /robot2/scan: --set topics.scan=/robot1/scan" in first
    assert "Odometry is there on /robot1/odom, /robot2/odom: --set topics.odometry=/robot1/odom" in second
    (cloud,) = [
        one
        for one in look(*good(), *others, settings=config("sensing.source=points", "topics.points=/points")).warnings()
        if "no message" in one
    ]
    assert cloud.endswith("and 20 more")


def test_pauses_that_would_stop_the_robot():
    messages = [one for one in good(6.0) if not 2.0 < one.time * 1e-9 - BEGIN < 4.5 or one.topic == "/odom"]
    (warning,) = look(*messages).warnings()
    assert "/scan paused for 2." in warning
    ended = [one for one in good(6.0) if one.time * 1e-9 - BEGIN < 3.0 or one.topic == "/scan"]
    assert any("/odom paused" in one for one in look(*ended).warnings())


def test_frames_and_clocks():
    messages = [scan(tick * 0.1) for tick in range(30)] + [pose(tick * 0.1, "odom") for tick in range(30)]
    assert any("in the frame 'odom'" in one for one in look(*messages).warnings())
    late = [scan(tick * 0.1) for tick in range(30)] + [pose(tick * 0.1, stamp=tick * 0.1 - 60) for tick in range(30)]
    assert any("another clock" in one for one in look(*late).warnings())
    back = [*good(), pose(1.55, stamp=0.5)]
    assert any("1 stamps are older" in one for one in look(*back).warnings())
    changing = [*good(), scan(1.55, frame="base")]
    assert any("changes its frame" in one for one in look(*changing).warnings())


def test_values_of_grids():
    cells = np.array([[-1, -1, 0, 0, 0], [100, 40, 45, 0, 0]], np.int8)
    grid = recorded("/map", GRID, 0.0, occupancy_grid(BEGIN - 500.0, "map", cells, 0.1))
    checks = look(*good(), grid, settings=config("topics.map=/map", "sensing.source=grid"))
    assert checks.topics["/map"].notes() == (
        "5 x 2 of 0.1 m: unknown 20.0 %, free 50.0 %, occupied 10.0 %, other 20.0 %"
    )
    assert [one for one in checks.warnings() if "20.0 % of the cells are between" in one]
    assert not [one for one in checks.warnings() if "another clock" in one], "a latched map may be old"
    shares = dict(histogram(checks.topics["/map"].values))
    assert sum(shares.values()) == pytest.approx(1.0)
    assert shares["-1"] == pytest.approx(0.2)


def test_clouds_transforms_and_strangers():
    cloud = recorded("/points", "sensor_msgs/msg/PointCloud2", 0.0, point_cloud(BEGIN, "map", np.ones((7, 3), "f4")))
    tf = transform_message([transform(BEGIN, "map", "odom", Pose(0.0, 0.0))])
    checks = look(
        *good(),
        cloud,
        recorded("/tf", "tf2_msgs/msg/TFMessage", 0.0, tf),
        Recorded("/custom", "my_msgs/msg/Thing", round(BEGIN * 1e9), b"\0\1\0\0"),
        Recorded("/scan", SCAN, round((BEGIN + 1.0) * 1e9), b"nonsense"),
    )
    assert checks.topics["/points"].notes() == "7 points"
    assert list(checks.topics["/tf"].frames) == ["map -> odom"]
    assert checks.topics["/custom"].count == 1
    assert any("1 of 31 messages cannot be read" in one for one in checks.warnings())


def test_a_blind_lidar():
    blind = [one for tick in range(30) for one in (pose(tick * 0.1), scan(tick * 0.1, (np.inf, np.inf)))]
    assert any("no beam ever returned" in one for one in look(*blind).warnings())


def test_scans_of_which_the_bridge_would_say_something_are_named():
    """The lidar says 0 where it meets nothing, and counts the time of a beam in milliseconds."""
    messages = good()
    for tick in range(30):
        seen = Scan(np.array([2.0, 0.0, 0.0, 3.0], np.float32), 0.0, 0.1, 10.0, 0.1)
        value = laser_scan(BEGIN + 0.1 * tick, "laser", seen)
        value.time_increment = 25.0
        messages.append(recorded("/scan", SCAN, 0.1 * tick + 0.05, value))
    warnings = look(*messages).warnings()
    assert any("/scan" in one and "sensing.no_return=0" in one and "30 messages" in one for one in warnings)
    assert any("/scan" in one and "time_increment" in one for one in warnings)


def test_why_a_scan_cannot_be_read_is_told():
    value = laser_scan(BEGIN, "laser", Scan(np.ones(4, np.float32), -180.0, 0.5, 10.0, 0.1))
    warnings = look(*good(), recorded("/scan", SCAN, 1.0, value)).warnings()
    assert any("1 of 31 messages cannot be read" in one for one in warnings)
    assert any("are they degrees?" in one for one in warnings)
