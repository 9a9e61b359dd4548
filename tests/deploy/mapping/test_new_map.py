"""Whether a SLAM that began a new map is noticed, and one that closed a loop is left in peace."""

import numpy as np
import pytest

from common.geometry import Pose
from common.mapping.sight import FREE, OCCUPIED
from deploy.mapping.robot_map import RobotMap
from deploy.profiles import load_deploy_config
from tests.deploy.mapping.lidar import RESOLUTION, room

WHOLE = np.where(room(), FREE, OCCUPIED).astype(np.int8)
"""15 m x 10 m, with its corner at (0, 0)."""
LEFT = WHOLE[:, :26]


class Robot:
    """A robot whose SLAM publishes transforms ten times a second, and maps when it is told to."""

    def __init__(self):
        self.map = RobotMap(load_deploy_config(None, [f"mapping.resolution={RESOLUTION}"], {}, "nav2"))
        self.now = 100.0
        self.stand(Pose(11.0, 5.0))
        self.publish(WHOLE)

    def stand(self, pose, passed=0.1):
        self.now += passed
        links = [(self.now, "map", "odom", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))]
        turn = (0.0, 0.0, float(np.sin(pose.yaw / 2)), float(np.cos(pose.yaw / 2)))
        self.map.add_transforms([*links, (self.now, "odom", "base_link", (pose.x, pose.y, 0.0), turn)])
        self.map.refresh()

    def publish(self, cells, corner=(0.0, 0.0)):
        self.map.add_grid(self.now, cells.copy(), RESOLUTION, (*corner, 0.0), "map")
        self.map.refresh()

    @property
    def misplaced(self):
        return self.map.statistics.misplaced


@pytest.mark.parametrize("map_first", [False, True])
def test_a_new_map_in_another_place_is_noticed_until_the_old_one_is_back(map_first):
    robot = Robot()
    if map_first:
        robot.publish(LEFT, (-8.0, -6.0))
    robot.stand(Pose(0.0, 0.0))
    robot.publish(LEFT, (-8.0, -6.0))
    assert "it began a new map, in which home and targets lie elsewhere" in robot.misplaced
    robot.stand(Pose(0.0, 0.0))
    robot.publish(LEFT, (-8.0, -6.0))
    assert robot.misplaced, "the same new map once more is no old one"
    robot.stand(Pose(11.0, 5.0))
    robot.publish(WHOLE)
    assert robot.misplaced == ""


def test_a_new_map_counts_after_a_reset():
    robot = Robot()
    robot.stand(Pose(0.0, 0.0))
    robot.publish(LEFT, (-8.0, -6.0))
    assert robot.misplaced
    robot.map.reset()
    assert robot.misplaced == ""
    assert robot.map.refresh() is not None, "the newest map counts, for it may come only once"
    robot.publish(LEFT, (-8.0, -6.0))
    assert robot.misplaced == ""


def test_a_slam_that_begins_anew_in_the_same_frame_has_moved_nothing():
    robot = Robot()
    robot.stand(Pose(3.0, 5.0), passed=20.0)
    robot.publish(LEFT, (0.25, -0.25))
    assert robot.misplaced == ""


def test_a_closed_loop_moves_pose_and_map_and_is_no_new_map():
    robot = Robot()
    robot.stand(Pose(14.0, 7.0))
    robot.publish(np.rot90(WHOLE), (4.0, 3.0))
    assert robot.misplaced == ""


def test_a_map_that_shrinks_while_the_robot_drives_is_no_new_one():
    robot = Robot()
    for step in range(5):
        robot.stand(Pose(11.0 - 0.1 * step, 5.0))
        robot.publish(LEFT, (-8.0, -6.0))
    assert robot.misplaced == ""
