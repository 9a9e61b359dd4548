"""What the bridge hears, from messages to faults, without a network."""

import pytest

from common.geometry import Pose
from deploy.bridge.inputs import Inputs
from deploy.mapping.robot_map import RobotMap
from deploy.profiles import load_deploy_config
from deploy.ros2 import Received, RosError
from deploy.ros2.conversions import odometry, transform, transform_message
from deploy.safety.health import FaultKind, HealthMonitor

SECONDS = 3.0


class Robot:
    """A robot that drives straight ahead at 0.8 m/s, and whoever tells where it is."""

    def __init__(self, *settings):
        config = load_deploy_config(None, list(settings), profile="bare")
        self.health = HealthMonitor(config.safety)
        self.inputs = Inputs(config, RobotMap(config), self.health)
        self._due = []

    def publisher(self, rate, make, lag=0.0):
        """Publish `make(stamp, pose)` so many times a second, as it was `lag` seconds ago."""
        for number in range(round(rate * SECONDS)):
            now = number / rate + lag / 3.0
            self._due.append((now, make, now - lag))

    def jumps(self):
        """Let time pass, and return the reasons why the pose could not be believed."""
        reasons = set()
        for now, make, stamp in sorted(self._due, key=lambda each: each[0]):
            message, take = make(100.0 + stamp, Pose(0.8 * stamp, 0.0))
            take(message, Received(100.0 + now, 0, 0))
            faults = self.health.check(100.0 + now)
            reasons |= {fault.reason for fault in faults if fault.kind is FaultKind.POSE_JUMP}
        return " ".join(sorted(reasons))

    def tf(self, parent, child, offset=None):
        def make(stamp, pose):
            where = pose if offset is None else Pose(pose.x + offset, pose.y)
            if parent == "map":
                where = Pose(offset or 0.0, 0.0)
            return transform_message([transform(stamp, parent, child, where)]), self.inputs.take_transforms

        return make

    def odometry(self, offset=0.0):
        def make(stamp, pose):
            where = Pose(pose.x + offset, pose.y)
            return odometry(stamp, "map", "base_link", where), self.inputs.take_odometry

        return make


@pytest.mark.parametrize(("rate", "lag"), [(30, 0.02), (50, 0.08), (10, 0.0), (50, 0.3)])
def test_a_filter_and_a_driver_that_both_publish_the_base_are_named(rate, lag):
    """The filter stamps by what it measured last: its transforms come late, and lie between those of the driver."""
    robot = Robot("sensing.pose=tf")
    robot.publisher(10, robot.tf("map", "odom"))
    robot.publisher(50, robot.tf("odom", "base_link"))
    robot.publisher(rate, robot.tf("odom", "base_link", 0.6), lag)
    assert "two nodes publish the transform odom -> base_link and disagree" in robot.jumps()


@pytest.mark.parametrize(("rate", "lag"), [(10, 0.0), (10, 0.05), (2, 0.02)])
def test_two_localisations_are_named(rate, lag):
    robot = Robot("sensing.pose=tf")
    robot.publisher(30, robot.tf("odom", "base_link"))
    robot.publisher(10, robot.tf("map", "odom"))
    robot.publisher(rate, robot.tf("map", "odom", 0.6), lag)
    assert "two nodes publish the transform map -> odom and disagree" in robot.jumps()


@pytest.mark.parametrize(("rate", "lag"), [(30, 0.02), (50, 0.08), (10, 0.0)])
def test_two_odometries_are_named(rate, lag):
    robot = Robot()
    robot.publisher(50, robot.odometry())
    robot.publisher(rate, robot.odometry(0.6), lag)
    assert "two nodes publish the odometry" in robot.jumps()


@pytest.mark.parametrize("pose", ["tf", "odometry"])
def test_two_that_agree_are_no_fault(pose):
    robot = Robot(f"sensing.pose={pose}")
    for rate, lag in ((50, 0.0), (30, 0.05)):
        if pose == "tf":
            robot.publisher(10, robot.tf("map", "odom"), lag)
            robot.publisher(rate, robot.tf("odom", "base_link"), lag)
        else:
            robot.publisher(rate, robot.odometry(0.05 if lag else 0.0), lag)
    assert robot.jumps() == ""


def test_a_robot_whose_odometry_changes_its_frame_is_told_why_its_poses_do_not_count():
    robot = Robot()

    def hear(now, frame):
        robot.inputs.take_odometry(odometry(now, frame, "base_link", Pose(0.0, 0.0)), Received(now, 0, 0))

    for tick in range(50):
        hear(100.0 + 0.1 * tick, "odom" if tick < 20 else "odom_combined")
    (fault,) = (each for each in robot.health.check(105.0) if each.kind is FaultKind.POSE_STALE)
    assert "those that arrive do not count: the odometry changed from the frame 'odom' to 'odom_comb" in fault.reason
    (fault,) = (each for each in robot.health.check(120.0) if each.kind is FaultKind.POSE_STALE)
    assert fault.reason.startswith("no pose for 18.1 s (limit") and fault.reason.endswith(")")


def test_a_robot_that_never_had_a_pose_is_told_why():
    robot = Robot()
    with pytest.raises(RosError):
        robot.inputs.take_odometry(odometry(100.0, "odom", "base_link", Pose(float("nan"), 0.0)), Received(100.0, 0, 0))
    (fault,) = (each for each in robot.health.check(100.1) if each.kind is FaultKind.POSE_STALE)
    assert fault.reason.startswith("no pose received yet; those that arrive do not count: a position must be finite")
