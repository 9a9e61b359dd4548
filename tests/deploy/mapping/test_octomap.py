"""OctoMap by option."""

import numpy as np
import pytest

from common.geometry import Pose
from common.mapping.sight import FREE, OCCUPIED
from deploy.mapping.robot_map import RobotMap
from tests.deploy.mapping.lidar import RESOLUTION, cloud_at, configure, room

pytest.importorskip("pyoctomap")


def octomap_of(resolution: float = 0.25, **sensing: object) -> RobotMap:
    return RobotMap(
        configure(
            sensing={"source": "points", "octomap": True, "octomap_resolution": resolution, **sensing},
            mapping={"resolution": 0.25},
        )
    )


def stand(robot_map: RobotMap, free: np.ndarray, pose: Pose, start: float, clouds: int = 3, **cloud: object):
    for k in range(clouds):
        robot_map.add_pose(start + k / 10, pose)
        robot_map.add_points(start + k / 10, cloud_at(free, pose, **cloud))
        mapper = robot_map.refresh()
    return mapper


@pytest.mark.parametrize("resolution", [0.25, 0.1])
def test_walls_and_floor_become_the_map(resolution):
    free, pose = room(), Pose(5.0, 5.0)
    mapper = stand(octomap_of(resolution), free, pose, 1.0)
    assert not mapper.stuck
    seen = mapper.belief.window((0.0, 0.0), free.shape)
    assert (seen[~free] == FREE).mean() < 0.01
    assert (seen[free] == OCCUPIED).mean() < 0.05
    assert np.count_nonzero(seen[free] == FREE) * RESOLUTION**2 > 20.0


def test_only_the_band_of_heights_counts():
    free, pose = room(), Pose(5.0, 5.0)
    low = np.array([[6.0, 5.0, 0.45], [6.0, 5.02, 0.45]], dtype=np.float32)
    high = low + np.array([0.0, -2.0, 1.6], dtype=np.float32)
    robot_map = octomap_of()
    for k in range(3):
        robot_map.add_pose(k / 10, pose)
        robot_map.add_points(k / 10, np.concatenate([cloud_at(free, pose), low, high]))
        belief = robot_map.refresh().belief
    assert belief.at((6.0, 5.0)) == OCCUPIED
    assert belief.at((6.0, 3.0)) != OCCUPIED


def person(mapper) -> np.ndarray:
    """The cells where the person stood, and those just before."""
    return mapper.belief.window((2.5, 5.0), (2, 3))


def test_a_person_who_walks_away_is_cleared_where_beams_return_from_behind():
    free, pose = room(), Pose(5.0, 5.0)
    crowded = free.copy()
    crowded[20:22, 10:12] = False
    robot_map = octomap_of()
    assert (person(stand(robot_map, crowded, pose, 1.0)) == OCCUPIED).any()
    assert (person(stand(robot_map, free, pose, 2.0, clouds=15)) != OCCUPIED).all()
