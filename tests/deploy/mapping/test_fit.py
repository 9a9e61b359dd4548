"""Whether the map still counts after the odometry leapt: scans that fit it go in, others do not."""

import numpy as np
import pytest

from common.geometry import Pose
from deploy.mapping.fit import agreement
from deploy.mapping.log_odds import Beams
from deploy.mapping.robot_map import RobotMap
from tests.deploy.mapping.lidar import configure, room, scan_at

HERE = Pose(4.1, 5.0, 0.3)


def see(robot_map: RobotMap, truth: Pose, told: Pose, start: float, scans: int = 5) -> float:
    """Stand at a place, with the odometry telling of another one; return the time."""
    for _ in range(scans):
        start += 0.1
        robot_map.add_pose(start, told)
        robot_map.add_scan(start, scan_at(room(), truth, noise=0.02, rng=np.random.default_rng(7)))
        robot_map.refresh()
    return start


@pytest.fixture
def known():
    """A map of the room, made from one place, and the time."""
    robot_map = RobotMap(configure())
    return robot_map, see(robot_map, HERE, HERE, 0.0)


@pytest.mark.parametrize(
    ("told", "silent"),
    [
        (Pose(6.5, 3.0, 0.3), 0.0),
        (Pose(4.1, 5.0, 1.9), 0.0),
        (Pose(5.0, 5.5, -0.4), 5.0),
    ],
    ids=["elsewhere", "turned", "after a silence"],
)
def test_what_does_not_fit_stays_out_of_the_map_until_the_odometry_is_put_right(known, told, silent):
    robot_map, now = known
    before = robot_map.statistics.integrated, robot_map.occupancy()[0]
    now = see(robot_map, HERE, told, now + silent)
    assert "does not fit its map any more" in robot_map.statistics.misplaced
    assert robot_map.statistics.integrated == before[0]
    assert np.array_equal(robot_map.occupancy()[0], before[1])
    # Another leap, to where the map knows nothing, does not make the map true.
    now = see(robot_map, HERE, Pose(300.0, 300.0), now)
    assert robot_map.statistics.misplaced
    see(robot_map, HERE, HERE, now)
    assert not robot_map.statistics.misplaced
    assert robot_map.statistics.integrated == before[0] + 5, "those that were compared count, too"


def test_poses_that_come_by_transforms_are_compared_too():
    robot_map, now = RobotMap(configure(sensing={"pose": "tf"})), 0.0

    def see_by_transforms(correction, scans):
        nonlocal now
        for _ in range(scans):
            now += 0.1
            links = ("map", "odom", correction), ("odom", "base_link", HERE)
            robot_map.add_transforms(
                (now, parent, child, (at.x, at.y, 0.0), (0.0, 0.0, np.sin(at.yaw / 2), np.cos(at.yaw / 2)))
                for parent, child, at in links
            )
            robot_map.add_scan(now, scan_at(room(), HERE))
            robot_map.refresh()

    see_by_transforms(Pose(0.0, 0.0), 5)
    see_by_transforms(Pose(1.7, -0.8), 5)
    assert "does not fit its map any more" in robot_map.statistics.misplaced
    assert robot_map.statistics.integrated == 5
    see_by_transforms(Pose(0.0, 0.0), 5)
    assert not robot_map.statistics.misplaced
    assert robot_map.statistics.integrated == 10


def test_a_robot_that_was_carried_goes_on_with_its_map(known):
    robot_map, now = known
    there = Pose(7.0, 8.0, -2.0)
    see(robot_map, there, there, now)
    assert not robot_map.statistics.misplaced
    assert robot_map.statistics.integrated == 10


def test_a_map_that_knows_nothing_there_contradicts_nothing(known):
    robot_map, now = known
    see(robot_map, HERE, Pose(300.0, 300.0), now)
    assert not robot_map.statistics.misplaced
    assert robot_map.statistics.integrated == 10


def test_a_reset_ends_the_doubt(known):
    robot_map, now = known
    now = see(robot_map, HERE, Pose(6.5, 3.0), now)
    robot_map.reset()
    assert not robot_map.statistics.misplaced
    see(robot_map, HERE, Pose(6.5, 3.0), now)
    assert robot_map.statistics.integrated == 5


def test_beams_agree_where_they_end_at_the_maps_obstacles(known):
    robot_map, _ = known
    cells = robot_map._survey.cells
    beams = Beams.from_scan(scan_at(room(), HERE), 0.1, 12.0)
    assert agreement(cells, beams, HERE) > 0.9
    assert agreement(cells, beams, Pose(6.5, 3.0, 0.3)) < 0.4
    assert agreement(cells, beams, Pose(300.0, 300.0)) is None
