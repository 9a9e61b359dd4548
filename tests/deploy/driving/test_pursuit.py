import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deploy.driving.pursuit import PathTracker

L = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0))


def test_place_on_the_path():
    path = PathTracker(L)
    assert path.length == 8.0
    assert path.advance(1.0, 0.5) == (1.0, 0.5)
    along, aside = path.advance(2.9, 0.0)
    assert (along, aside) == pytest.approx((2.9, 0.0))


def test_single_position():
    path = PathTracker([(3.0, 4.0)])
    assert path.advance(0.0, 0.0) == (0.0, 5.0)
    assert path.ahead(0.0, 0.0, np.array([2.5, 5.0])).tolist() == [[1.5, 2.0], [3.0, 4.0]]


def test_positions_ahead_lead_to_the_path_and_along_it():
    path = PathTracker(L)
    path.advance(3.0, -1.0)
    ahead = path.ahead(3.0, -1.0, np.array([0.5, 1.0, 2.0, 3.0, 99.0]))
    assert ahead == pytest.approx(np.array([(3.0, -0.5), (3.0, 0.0), (4.0, 0.0), (4.0, 1.0), (4.0, 4.0)]))


def test_way_back_over_itself_is_followed_in_order():
    path = PathTracker([(0.0, 0.0), (4.0, 0.0), (0.0, 0.0)])
    marks = [path.advance(x, 0.0)[0] for x in (0.0, 1.0, 2.0, 3.0, 4.0, 3.5, 3.0, 2.0, 1.0)]
    assert marks == pytest.approx([0.0, 1.0, 2.0, 3.0, 4.0, 4.5, 5.0, 6.0, 7.0])


def test_repeated_positions():
    path = PathTracker([(1.0, 1.0), (1.0, 1.0), (2.0, 1.0)])
    assert path.advance(1.5, 1.0) == pytest.approx((0.5, 0.0))


def test_a_part_of_the_path_beyond_a_loop_is_not_begun_with():
    # To a viewpoint in the corner of a room and back out, past where the robot is.
    path = PathTracker([(0.3, 0.0), (0.0, 2.4), (2.2, 2.0), (0.2, 0.3), (0.2, -3.0)])
    along, aside = path.advance(0.1, 0.1)
    assert along < 0.3
    assert aside < 0.25


def test_a_path_that_hardly_leads_away_before_a_corner_is_followed_around_it():
    assert PathTracker([(1, -1), (1, 0), (0, 0)]).advance(0.0, -1e-5) == (2.0, pytest.approx(1e-5))


@given(
    st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9)), min_size=1, max_size=6),
    st.floats(-9, 9),
    st.floats(-9, 9),
)
def test_the_first_place_is_the_nearest_until_the_path_leads_away(points, x, y):
    path = PathTracker(points)
    along, aside = path.advance(x, y)
    assert 0.0 <= along <= path.length
    px, py = path.point(along)
    assert np.hypot(px - x, py - y) == pytest.approx(aside, abs=1e-9)
    before = [path.point(mark) for mark in np.linspace(0.0, along, 200)]
    gaps = [np.hypot(px - x, py - y) for px, py in before]
    assert np.all(np.diff(gaps) <= 1e-6)
    corners = np.cumsum(np.hypot(*np.diff(points, axis=0).T)) if len(points) > 1 else np.zeros(1)
    px, py = path.point(next((mark for mark in corners if mark > along + 1e-6), path.length))
    assert np.hypot(px - x, py - y) >= aside - 1e-9


@given(st.floats(-1, 9), st.floats(-1, 5), st.floats(-1, 9), st.floats(-1, 5))
def test_a_later_place_is_the_nearest_around_the_last(x, y, later_x, later_y):
    path = PathTracker(L)
    first, _ = path.advance(x, y)
    along, aside = path.advance(later_x, later_y)
    near = [path.point(mark) for mark in np.linspace(max(first - 0.3, 0.0), min(first + 2.0, path.length), 200)]
    assert max(first - 0.3, 0.0) <= along <= first + 2.0 + 1e-9
    assert aside <= min(np.hypot(px - later_x, py - later_y) for px, py in near) + 1e-9
