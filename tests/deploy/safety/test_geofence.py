import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import ConfigError
from deploy.safety.geofence import Geofence

SQUARE = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0))
# A U that is open at the top.
HOLLOW = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (7.0, 10.0), (7.0, 3.0), (3.0, 3.0), (3.0, 10.0), (0.0, 10.0))


def test_no_fence_allows_everything():
    fence = Geofence(())
    assert not fence.exists
    assert fence.contains((1e6, 1e6))
    assert fence.clip([(0.0, 0.0), (1e6, 0.0)]) == [(0.0, 0.0), (1e6, 0.0)]


def test_inside_edge_and_outside():
    fence = Geofence(SQUARE)
    assert fence.contains((5.0, 5.0))
    assert fence.contains((10.0, 5.0))
    assert not fence.contains((10.01, 5.0))


def test_margin():
    fence = Geofence(SQUARE, margin=0.5)
    assert fence.contains((9.4, 5.0))
    assert not fence.contains((9.6, 5.0))


def test_straight_line_between_two_inner_places_may_lead_outside():
    fence = Geofence(HOLLOW)
    assert not fence.allows((1.0, 9.0), (9.0, 9.0))
    assert fence.allows((1.0, 1.0), (9.0, 1.0))
    assert fence.allows((1.0, 1.0), (1.0, 1.0))


def test_path_is_cut_where_it_leaves():
    fence = Geofence(HOLLOW)
    assert fence.clip([(1.0, 9.0), (1.0, 1.0), (9.0, 1.0), (12.0, 1.0), (9.0, 2.0)]) == [
        (1.0, 9.0),
        (1.0, 1.0),
        (9.0, 1.0),
    ]
    assert fence.clip([(1.0, 9.0), (9.0, 9.0)]) == [(1.0, 9.0)]
    assert fence.clip([]) == []


def test_robot_outside_may_only_come_back():
    fence = Geofence(SQUARE)
    assert fence.clip([(-1.0, 5.0), (1.0, 5.0), (2.0, 5.0)]) == [(-1.0, 5.0), (1.0, 5.0), (2.0, 5.0)]
    assert fence.clip([(-1.0, 5.0), (-2.0, 5.0)]) == []


@pytest.mark.parametrize(
    ("corners", "margin", "words"),
    [
        (((0.0, 0.0), (10.0, 10.0), (10.0, 0.0), (0.0, 10.0)), 0.0, "Self-intersection"),
        (((0.0, 0.0), (1.0, 1.0)), 0.0, "fewer than 3"),
        (((0.0, 0.0), (1.0, 1.0), (2.0, 2.0)), 0.0, "sides do not cross"),
        (((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)), 0.6, "no room"),
    ],
)
def test_what_is_no_polygon_is_refused(corners, margin, words):
    with pytest.raises(ConfigError, match=words):
        Geofence(corners, margin)


@given(
    st.lists(st.tuples(st.floats(-5, 15), st.floats(-5, 15)), min_size=1, max_size=8),
)
def test_clipped_paths_stay_inside(path):
    fence = Geofence(SQUARE)
    kept = fence.clip(path)
    assert kept == path[: len(kept)]
    inside = kept if not kept or fence.contains(kept[0]) else kept[1:]
    for (ax, ay), (bx, by) in pairwise(inside):
        for part in (0.0, 0.3, 0.7, 1.0):
            x, y = ax + part * (bx - ax), ay + part * (by - ay)
            assert -1e-9 <= x <= 10.0 + 1e-9
            assert -1e-9 <= y <= 10.0 + 1e-9
    assert all(map(math.isfinite, (value for place in kept for value in place)))
