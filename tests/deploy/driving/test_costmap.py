import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deploy.config import DrivingConfig
from deploy.driving.costmap import LocalCostmap

CONFIG = DrivingConfig()
near = st.floats(-3.9, 3.9)


def costmap(points, x: float = 0.0, y: float = 0.0) -> LocalCostmap:
    made = LocalCostmap(CONFIG)
    made.update(x, y, np.array(points, float).reshape(-1, 2), 0.0)
    return made


@given(st.lists(st.tuples(near, near), min_size=1, max_size=20), near, near)
def test_distances_are_exact_up_to_the_cap(points, x, y):
    made = costmap(points)
    field = made.field
    column, row = int((x - field.left) / field.resolution), int((y - field.bottom) / field.resolution)
    middle = field.left + (column + 0.5) * field.resolution, field.bottom + (row + 0.5) * field.resolution
    exact = min(field.cap, np.hypot(*(made.points - middle).T).min())
    assert made.distances(np.array([(x, y)]))[0] == pytest.approx(exact)
    # Thinning moves no obstacle by more than a small cell's diagonal.
    assert abs(exact - min(field.cap, np.hypot(*(np.array(points) - middle).T).min())) < 0.03


def test_cells_stay_in_place_when_the_robot_moves():
    first, second = costmap([(1.0, 0.5)], 0.0), costmap([(1.0, 0.5)], 0.033)
    places = np.array([(0.77, 0.31), (1.2, 0.4)])
    assert np.array_equal(first.distances(places), second.distances(places))


def test_dense_clouds_are_thinned():
    cloud = np.random.default_rng(0).uniform(0.9, 1.1, (20000, 2))
    assert len(costmap(cloud).points) <= 121


def test_points_close_to_the_robot_are_remembered_for_a_second():
    made = LocalCostmap(CONFIG)
    none = np.empty((0, 2))
    made.update(0.0, 0.0, np.array([(0.4, 0.0), (2.0, 0.0)]), 0.0)
    made.update(0.0, 0.0, none, 0.9)
    assert made.points.tolist() == [[0.4, 0.0]]
    made.update(0.0, 0.0, none, 1.1)
    assert len(made.points) == 0


def test_free_lines_keep_the_room():
    made = costmap([(2.0, made_room := CONFIG.robot_radius + CONFIG.clearance)])
    assert made.free_line((0.0, 0.0), (4.0, 0.0))
    assert not made.free_line((0.0, 0.01), (4.0, 0.01))
    assert made.room == pytest.approx(made_room)


def test_line_away_from_what_is_too_near_is_free():
    made = costmap([(0.2, 0.0)])
    assert made.free_line((0.0, 0.0), (-2.0, 0.0))
    assert not made.free_line((0.0, 0.0), (2.0, 0.5))
