"""Unknown cells beside obstacles: closed as far as no robot can be in them, and not a cell farther."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.geometry import Pose
from common.mapping.sight import FREE, OCCUPIED, UNKNOWN
from deploy.mapping.footprint import clear_footprint, footprint_box
from deploy.mapping.rims import close_rims, rim_offsets
from deploy.mapping.robot_map import RobotMap
from tests.deploy.mapping.lidar import configure


def closed(states: np.ndarray, offsets: np.ndarray, box: tuple[int, int, int, int] | None = None) -> np.ndarray:
    top, bottom, left, right = box or (0, states.shape[0] - 1, 0, states.shape[1] - 1)
    out = states[top : bottom + 1, left : right + 1].copy()
    close_rims(states, offsets, int(np.abs(offsets).max(initial=0)), (top, bottom, left, right), out)
    return out


@settings(max_examples=40)
@given(st.sampled_from([0.05, 0.1, 0.2, 0.25]), st.floats(0.0, 0.6), st.integers(0, 10**6))
def test_only_unknown_cells_where_no_part_of_the_robot_can_be_are_closed(resolution, radius, seed):
    rng = np.random.default_rng(seed)
    states = rng.choice([UNKNOWN, UNKNOWN, FREE], size=(14, 14)).astype(np.int8)
    obstacles = rng.integers(0, 14, (6, 2))
    states[tuple(obstacles.T)] = OCCUPIED
    out = closed(states, rim_offsets(resolution, radius))
    assert np.array_equal(out[states != UNKNOWN], states[states != UNKNOWN])
    # Places of the robot's middle, beside the grid as well, that leave it the radius along the way from every obstacle.
    margin = int(np.ceil(radius / resolution)) + 1
    places = np.argwhere(np.ones((14 + 2 * margin,) * 2)) - margin
    free_places = places[~near(places, obstacles, resolution, radius).any(axis=1)]
    cells = np.argwhere(states == UNKNOWN)
    covered = near(cells, free_places, resolution, radius).any(axis=1)
    beside = near(cells, obstacles, resolution, radius).any(axis=1)
    assert np.array_equal(out[tuple(cells.T)] == OCCUPIED, beside & ~covered)


def near(a, b, resolution, radius):
    """Whether cells are nearer than the radius by half a cell, of the one to the nearest point of the other."""
    gaps = np.maximum(np.abs(a[:, None] - b[None]) - 0.5, 0.0) * resolution
    return np.hypot(gaps[..., 0], gaps[..., 1]) < radius - resolution / 2 - 1e-9


def test_a_part_is_closed_as_the_whole_is():
    rng = np.random.default_rng(3)
    states = rng.choice([UNKNOWN] * 9 + [FREE] * 8 + [OCCUPIED], size=(40, 50)).astype(np.int8)
    offsets = rim_offsets(0.1, 0.35)
    whole = closed(states, offsets)
    assert (whole != states).any()
    for box in ((3, 9, 30, 49), (0, 0, 0, 0), (20, 39, 0, 10)):
        assert np.array_equal(closed(states, offsets, box), whole[box[0] : box[1] + 1, box[2] : box[3] + 1])


def test_a_door_that_the_robot_fits_through_stays_unknown_from_jamb_to_jamb():
    states = np.full((21, 21), UNKNOWN, dtype=np.int8)
    states[:10] = FREE
    states[10, :7] = states[10, 14:] = OCCUPIED
    out = closed(states, rim_offsets(0.1, 0.3))
    assert (out[10, 7:14] == UNKNOWN).all()
    assert (out[15:] == UNKNOWN).all()


@pytest.mark.parametrize(("radius", "slits"), [(0.0, True), (0.3, False)])
def test_a_robot_with_a_size_does_not_look_into_slits(radius, slits):
    """Between two cupboards 0.2 m apart nothing can be that a robot of 0.6 m gets to; a target there stays unknown."""
    cells = np.full((60, 60), FREE, dtype=np.int8)
    cells[:, [0, -1]] = cells[[0, -1]] = OCCUPIED
    cells[:10, 20:40] = OCCUPIED
    cells[:10, 29:31] = UNKNOWN
    robot_map = RobotMap(
        configure(sensing={"source": "grid", "hole_area": 0.0}, mapping={"resolution": 0.1, "robot_radius": radius})
    )
    robot_map.add_pose(1.0, Pose(3.0, 4.0))
    robot_map.add_grid(1.0, cells, 0.1, (0.0, 0.0, 0.0))
    slit = (3.0, 0.5)
    mapper = robot_map.refresh()
    assert (len(mapper.frontiers) > 0) == slits
    assert (mapper.belief.cells[mapper.belief.cell(slit)] == UNKNOWN) == slits
    robot_map.set_target(slit)
    mapper = robot_map.refresh()
    assert mapper.belief.cells[mapper.belief.cell(slit)] == UNKNOWN
    assert (len(mapper.frontiers) > 0) == slits


@given(st.floats(-3.0, 15.0), st.floats(-3.0, 15.0), st.floats(0.2, 4.0))
def test_the_robots_own_place_is_free_and_nothing_else_changes(row, column, radius):
    cells = np.full((12, 12), OCCUPIED, dtype=np.int8)
    box = footprint_box((row, column), radius, cells.shape)
    whole = cells.copy()
    clear_footprint(whole, (0, 11, 0, 11), (row, column), radius)
    for r, c in np.ndindex(cells.shape):
        own = (int(np.floor(row)), int(np.floor(column))) == (r, c)
        covered = own or np.hypot(r + 0.5 - row, c + 0.5 - column) <= radius
        assert (whole[r, c] == FREE) == covered
        if covered:
            assert box[0] <= r <= box[1]
            assert box[2] <= c <= box[3]
