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


@given(
    st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=1, max_size=6), st.floats(-9, 9), st.floats(-9, 9)
)
def test_first_place_is_about_the_nearest(points, x, y):
    path = PathTracker(points)
    along, aside = path.advance(x, y)
    assert 0.0 <= along <= path.length
    samples = [path.point(mark) for mark in np.linspace(0.0, path.length, 200)]
    nearest = min(np.hypot(px - x, py - y) for px, py in samples)
    assert aside <= nearest + 0.06 * len(points)
