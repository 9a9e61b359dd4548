import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.simulators.tracking import DriveLimits, SegmentTracker, wrap_angle
from common.geometry import Pose

INTERVAL = 1 / 60
LIMITS = DriveLimits(speed=2.0)


def drive(start, goal, limits=LIMITS):
    """Integrate the commands of a tracker on an ideal unicycle."""
    tracker = SegmentTracker(start, goal, limits)
    pose, commands, poses = start, [], [start]
    while not tracker.at_goal(pose):
        speed, turn_rate = tracker.command(pose, INTERVAL)
        commands.append((speed, turn_rate))
        yaw = pose.yaw + turn_rate * INTERVAL
        pose = Pose(pose.x + speed * INTERVAL * math.cos(yaw), pose.y + speed * INTERVAL * math.sin(yaw), yaw)
        poses.append(pose)
        assert len(commands) * INTERVAL < tracker.time_limit()
    return poses, commands


@given(
    yaw=st.floats(-math.pi, math.pi),
    bearing=st.floats(-math.pi, math.pi),
    distance=st.floats(0.1, 12.0),
    speed=st.sampled_from([0.5, 1.0, 2.0, 3.0]),
)
def test_it_arrives_within_limits_and_stays_near_the_segment(yaw, bearing, distance, speed):
    limits = DriveLimits(speed=speed)
    goal = (3.0 + distance * math.cos(bearing), -2.0 + distance * math.sin(bearing))
    poses, commands = drive(Pose(3.0, -2.0, yaw), goal, limits)
    assert poses[-1].distance_to(goal) <= limits.tolerance
    previous = (0.0, 0.0)
    for command in commands:
        assert -1e-9 <= command[0] <= speed + 1e-9
        assert abs(command[1]) <= limits.turn_rate + 1e-9
        assert abs(command[0] - previous[0]) <= limits.acceleration * INTERVAL + 1e-9
        assert abs(command[1] - previous[1]) <= limits.turn_acceleration * INTERVAL + 1e-9
        previous = command
    for pose in poses:
        across = (pose.y + 2.0) * math.cos(bearing) - (pose.x - 3.0) * math.sin(bearing)
        assert abs(across) < 0.06


def test_it_arrives_slowly():
    _, commands = drive(Pose(0.0, 0.0, 0.0), (6.0, 0.0))
    assert max(speed for speed, _ in commands) == pytest.approx(2.0)
    assert commands[-1][0] < 0.6


def test_it_turns_the_short_way_and_in_place():
    poses, commands = drive(Pose(0.0, 0.0, 3.0), (-4.0, -3.0))
    first = next(k for k, (speed, _) in enumerate(commands) if speed > 0.0)
    assert commands[first // 2][1] > 0.0
    assert poses[first].distance_to((0.0, 0.0)) < 1e-9


@given(st.floats(-50.0, 50.0))
def test_angles_are_wrapped(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi <= wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-9)
