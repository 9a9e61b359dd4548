"""Small unknown areas that known cells enclose: closed for planners, never at the cost of what is known or open."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from common.geometry import Pose
from common.mapping.belief import Belief
from common.mapping.sight import FREE, OCCUPIED, UNKNOWN
from deploy.mapping.robot_map import RobotMap
from deploy.mapping.small_holes import SmallHoles
from tests.deploy.mapping.lidar import configure, room, scan_at


def belief_of(cells: np.ndarray) -> Belief:
    belief = Belief(1.0, 10.0, anchor=(0.0, 0.0))
    belief.assign(cells, (0.0, 0.0))
    return belief


def whole(belief: Belief) -> tuple[int, int, int, int]:
    return 0, belief.shape[0] - 1, 0, belief.shape[1] - 1


def expected(cells: np.ndarray, area: int) -> np.ndarray:
    """Enclosed components of unknown cells, corners included, no larger than `area`, with a free cell beside them."""
    unknown = np.pad(cells == UNKNOWN, 1, constant_values=True)
    labels, _ = ndimage.label(unknown, np.ones((3, 3)))
    free = np.pad(cells == FREE, 1)
    beside = ndimage.binary_dilation(free)
    hole = np.zeros_like(unknown)
    for label in np.unique(labels[unknown]):
        here = labels == label
        if label != labels[0, 0] and here.sum() <= area and (here & beside).any():
            hole |= here
    return hole[1:-1, 1:-1]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 12), st.floats(0.2, 0.8))
def test_it_finds_what_is_enclosed_and_small_and_nothing_else(seed, area, share):
    random = np.random.default_rng(seed)
    cells = np.where(random.random((24, 30)) < share, FREE, UNKNOWN).astype(np.int8)
    cells[random.random(cells.shape) < 0.2] = OCCUPIED
    belief = belief_of(cells)
    found = SmallHoles(float(area), 1.0).find(belief, whole(belief))
    mask = np.zeros(cells.shape, dtype=np.bool_)
    mask[tuple(found.T)] = True
    np.testing.assert_array_equal(mask, expected(cells, area))


def test_known_holes_stay_where_they_are_when_the_grid_grows():
    cells = np.zeros((9, 9), dtype=np.int8)
    cells[4, 4] = UNKNOWN
    belief = belief_of(cells)
    holes = SmallHoles(2.0, 1.0)
    assert holes.find(belief, whole(belief)).tolist() == [[4, 4]]
    larger = np.full((15, 15), UNKNOWN, dtype=np.int8)
    holes.close(larger, (-3, -2))
    assert np.argwhere(larger == OCCUPIED).tolist() == [[7, 6]]
    known = np.zeros((15, 15), dtype=np.int8)
    holes.close(known, (-3, -2))
    assert not known.any()


def test_only_what_touches_the_part_is_looked_at():
    cells = np.zeros((9, 20), dtype=np.int8)
    cells[4, 4] = cells[4, 15] = UNKNOWN
    belief = belief_of(cells)
    assert SmallHoles(2.0, 1.0).find(belief, (0, 8, 0, 9)).tolist() == [[4, 4]]


def furnished() -> np.ndarray:
    """A closed room of 9 m x 9 m with a cupboard that has a niche, open to the right, of 0.75 m x 0.75 m."""
    free = np.zeros((40, 40), dtype=np.bool_)
    free[2:38, 2:38] = True
    free[17:24, 12:16] = False
    free[19:22, 13:16] = True
    return free


NICHE = (13.5 * 0.25, 20.5 * 0.25)


def look(robot_map: RobotMap, free: np.ndarray, *places: tuple[float, float], start: float = 0.0) -> None:
    for k, (x, y) in enumerate(places):
        for scan in range(3):
            time = start + k + 0.1 * scan
            robot_map.add_pose(time, Pose(x, y))
            robot_map.add_scan(time, scan_at(free, Pose(x, y)))
        robot_map.refresh()


# Around the cupboard, but never where the back of the niche can be seen.
ROUND = [(1.5, 2.0), (1.5, 8.0), (4.3, 9.0), (4.3, 1.2)]


@pytest.mark.parametrize("hole", [0.0, 1.0])
def test_an_exploration_is_done_with_a_room_but_for_its_holes(hole):
    robot_map = RobotMap(configure(sensing={"hole_area": hole}))
    look(robot_map, furnished(), *ROUND)
    mapper = robot_map.refresh()
    assert (len(mapper.frontiers) == 0) == (hole > 0.0)
    assert mapper.observe().utility.any() == (hole == 0.0)
    # What is published is what was measured.
    occupancy, _, _ = robot_map.occupancy()
    assert (occupancy == UNKNOWN).any()


def test_a_look_into_a_hole_shows_what_is_in_it():
    robot_map = RobotMap(configure())
    free = furnished()
    look(robot_map, free, *ROUND)
    assert robot_map.refresh().belief.at(NICHE) == OCCUPIED
    look(robot_map, free, (6.0, 20.5 * 0.25), start=20.0)
    assert robot_map.refresh().belief.at(NICHE) == FREE


def test_on_the_way_to_a_target_holes_are_unknown_again():
    robot_map = RobotMap(configure())
    look(robot_map, furnished(), *ROUND)
    assert robot_map.refresh().belief.at(NICHE) == OCCUPIED
    robot_map.set_target(NICHE)
    assert robot_map.refresh().belief.at(NICHE) == UNKNOWN
    robot_map.set_target(None)
    assert robot_map.refresh().belief.at(NICHE) == OCCUPIED


def test_the_map_of_a_slam_may_open_a_hole_again():
    robot_map = RobotMap(configure(sensing={"source": "grid"}))
    robot_map.add_pose(1.0, Pose(1.5, 2.0))
    cells = np.where(furnished(), FREE, OCCUPIED).astype(np.int8)
    cells[19:22, 13:16] = UNKNOWN
    cells[19:22, 16] = OCCUPIED
    cells[20, 16] = FREE
    robot_map.add_grid(1.0, cells, 0.25, (0.0, 0.0, 0.0))
    assert robot_map.refresh().belief.at(NICHE) == OCCUPIED
    cells[10:35, 10:35] = UNKNOWN
    robot_map.add_grid(2.0, cells, 0.25, (0.0, 0.0, 0.0))
    assert robot_map.refresh().belief.at(NICHE) == UNKNOWN


def test_a_room_behind_a_narrow_door_is_no_hole():
    robot_map = RobotMap(configure())
    free = room()
    free[16:26, 36:38] = False
    free[20, 36:38] = True
    look(robot_map, free, (2.0, 2.0))
    assert robot_map.refresh().observe().utility.any()
