"""A robot whose sensor, pose or clock fails while it drives, on a real bus: how soon it stands, and that it continues.

Run with `pytest -s` for the figures; distances are what the robot itself drove after the first spoilt message.
"""

import copy
import threading
import time

import numpy as np
import pytest

from deploy.bridge.bridge import Bridge
from tests.common.bus.processes import eventually
from tests.common.planners.worlds import ARMS
from tests.deploy.bridge.robots import FakeRobot, network

MAPPING = {"resolution": 0.25, "viewpoint_spacing": 2.0, "sensor_range": 10.0, "beacon_range": 10.0}
RADIUS = 0.2
# What a loaded machine may add, seconds; the robot drives 1 m/s and stands at once when it gets zeros.
BUSY = 0.6


@pytest.fixture(scope="module")
def pair():
    router, config = network(
        mapping={**MAPPING, "robot_radius": RADIUS},
        driving={"enabled": True, "robot_radius": RADIUS},
        topics={"stop": "", "velocity": "/cmd_vel"},
        decision={"task": "navigation", "planner": "astar"},
        safety={"scan_timeout": 1.0, "pose_timeout": 1.0},
    )
    stop = threading.Event()
    with FakeRobot(ARMS, router, by_velocity=True) as robot, Bridge(config) as bridge:
        thread = threading.Thread(target=bridge.run, args=(stop,))
        thread.start()
        yield robot, bridge
        stop.set()
        thread.join()


@pytest.fixture
def rolling(pair):
    """A robot that drives along the corridor at half a metre per second or more."""
    robot, _ = pair
    heal(robot)
    left, right = ARMS.start[0] - 16.0, ARMS.start[0] + 16.0
    goal = left if robot.pose.x > ARMS.start[0] else right
    robot.say(f"goal {goal} {ARMS.start[1]}")
    robot.say("start")
    assert eventually(lambda: fast(robot) and robot.status["faults"] == {}, 60), robot.status
    yield robot
    heal(robot)


def heal(robot):
    robot.spoil_scan = robot.spoil_odometry = lambda message: message


def fast(robot):
    return len(robot.velocities) > 5 and all(linear > 0.5 for _, (linear, _) in robot.velocities[-5:])


def time_to_stand(robot, what):
    """Wait until the robot stands; return (seconds, metres, kinds of fault seen)."""
    began, driven = time.monotonic(), robot.driven
    last, at, kinds = began, driven, set()
    while time.monotonic() - began < 10.0 and time.monotonic() - last < 0.5:
        kinds |= set(robot.status["faults"])
        if robot.driven != at:
            last, at = time.monotonic(), robot.driven
        time.sleep(0.02)
    # The status is told twice a second, perhaps later than the robot stands.
    eventually(lambda: bool(robot.status["faults"]), 2)
    kinds |= set(robot.status["faults"])
    print(f"{what}: stands after {last - began:.2f} s and {at - driven:.2f} m: {', '.join(sorted(kinds))}")
    return last - began, at - driven, kinds


def goes_on(robot):
    driven = robot.driven
    return eventually(lambda: robot.driven > driven + 0.5, 30)


class Repeat:
    """Returns the first message that it gets ever after, perhaps with new stamps."""

    def __init__(self, *, new_stamps):
        self.first = None
        self.new_stamps = new_stamps

    def __call__(self, message):
        self.first = self.first or message
        again = copy.copy(self.first)
        if self.new_stamps:
            again.header = message.header
        return again


def alike(*values):
    """A case that differs from another one in what tests/deploy/safety see of scans and stamps without a robot."""
    return pytest.param(*values, marks=pytest.mark.slow)


def ranges(change):
    """Return what spoils the ranges of a scan."""

    def spoil(scan):
        scan.ranges = np.asarray(change(np.array(scan.ranges)), np.float32)
        return scan

    return spoil


def stretched(scan):
    scan.angle_increment *= 360 / 350
    return scan


def frozen_pose(robot):
    """Odometry with new stamps whose pose stands, while its velocity tells that the wheels turn."""
    first = []

    def spoil(odometry):
        first.append(odometry.pose)
        odometry.pose = first[0]
        return odometry

    return spoil


@pytest.mark.timeout(180)
@pytest.mark.parametrize(
    ("what", "spoil", "fault", "seconds"),
    [
        ("scans with the same stamp", Repeat(new_stamps=False), "sensor_frozen", 0.6),
        alike("the same scan with new stamps", Repeat(new_stamps=True), "sensor_frozen", 0.6),
        ("all NaN", ranges(lambda r: np.full_like(r, np.nan)), "sensor_blind", 0.4),
        alike("all zeros", ranges(np.zeros_like), "sensor_blind", 0.4),
        alike("10 valid beams", ranges(lambda r: np.where(np.arange(len(r)) < 10, r, np.nan)), "sensor_blind", 0.4),
        alike("10 beams in all", ranges(lambda r: r[:10]), "sensor_invalid", 0.4),
        ("angles that do not fit", stretched, "sensor_invalid", 0.4),
    ],
)
def test_a_sensor_that_shows_nothing_stops_the_robot(rolling, what, spoil, fault, seconds):
    rolling.spoil_scan = spoil
    took, metres, kinds = time_to_stand(rolling, what)
    assert fault in kinds
    assert took < seconds + BUSY
    assert metres < seconds + BUSY
    heal(rolling)
    assert goes_on(rolling)
    assert rolling.status["faults"] == {}


@pytest.mark.timeout(180)
@pytest.mark.parametrize(
    ("what", "spoil", "seconds"),
    [
        ("poses with the same stamp", lambda robot: Repeat(new_stamps=False), 1.0),
        ("a pose that stands while the wheels turn", frozen_pose, 0.5),
    ],
)
def test_a_pose_that_stands_stops_the_robot(rolling, what, spoil, seconds):
    rolling.spoil_odometry = spoil(rolling)
    took, metres, kinds = time_to_stand(rolling, what)
    assert "pose_frozen" in kinds
    assert took < seconds + BUSY
    assert metres < seconds + BUSY
    heal(rolling)
    assert goes_on(rolling)
    assert rolling.status["faults"] == {}


@pytest.mark.timeout(180)
@pytest.mark.parametrize("back", [alike(0.2), 1.0, alike(3.0), alike(10.0)])
def test_a_clock_that_is_set_back_stops_the_robot_until_the_bridge_has_begun_anew(rolling, pair, back):
    rolling.clock -= back
    took, metres, kinds = time_to_stand(rolling, f"clock set back by {back:g} s")
    assert "clock_set_back" in kinds
    assert took < 0.3 + BUSY
    assert metres < 0.3 + BUSY
    assert goes_on(rolling)
    assert rolling.status["faults"] == {}
    x, y, _ = pair[1].status()["pose"]
    assert rolling.pose.distance_to((x, y)) < 0.5
