import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import ConfigError
from common.geometry import Pose
from deploy.config import DeployConfig
from deploy.safety.geofence import Geofence

SQUARE = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0))
# A U that is open at the top.
HOLLOW = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (7.0, 10.0), (7.0, 3.0), (3.0, 3.0), (3.0, 10.0), (0.0, 10.0))


def test_no_fence_allows_everything():
    fence = Geofence(())
    assert fence.contains((1e6, 1e6))
    assert fence.allows((0.0, 0.0), (1e6, 0.0))
    assert fence.holds(Pose(1e6, 1e6))


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


def test_a_robot_in_the_margin_may_only_go_back_in():
    fence = Geofence(HOLLOW, margin=0.5)
    assert fence.allows((0.2, 5.0), (1.0, 5.0))
    assert not fence.allows((0.2, 5.0), (0.2, 6.0))
    assert not fence.allows((1.0, 5.0), (0.2, 5.0))
    assert not fence.allows((2.8, 9.0), (8.0, 9.0)), "not across what lies outside"
    assert not fence.allows((-1.0, 5.0), (1.0, 5.0)), "one outside is driven back by its operator"


def test_a_round_robot_is_inside_with_its_whole_circle():
    fence = Geofence.around_robot(DeployConfig(driving={"robot_radius": 0.4}, safety={"geofence": SQUARE}))
    assert fence.holds(Pose(9.6, 5.0))
    assert not fence.holds(Pose(9.65, 5.0))


@pytest.mark.parametrize(("yaw", "inside"), [(0.0, False), (math.pi / 2, True), (math.pi, True), (math.pi / 4, False)])
def test_a_long_robot_is_inside_with_its_whole_footprint(yaw, inside):
    # 1 m before its centre, 0.4 m behind, 0.6 m wide.
    footprint = [(1.0, 0.3), (-0.4, 0.3), (-0.4, -0.3), (1.0, -0.3)]
    fence = Geofence.around_robot(DeployConfig(driving={"footprint": footprint}, safety={"geofence": SQUARE}))
    assert fence.holds(Pose(9.5, 5.0, yaw)) == inside


@given(st.floats(-1.0, 11.0), st.floats(-1.0, 11.0), st.floats(-4.0, 4.0))
def test_a_footprint_is_inside_when_all_its_corners_are(x, y, yaw):
    footprint = [(0.6, 0.2), (-0.3, 0.4), (-0.3, -0.2)]
    corners = [
        (x + math.cos(yaw) * a - math.sin(yaw) * b, y + math.sin(yaw) * a + math.cos(yaw) * b) for a, b in footprint
    ]
    room = min(min(value, 10.0 - value) for corner in corners for value in corner)
    if abs(room) > 1e-9:
        assert Geofence(SQUARE, outline=footprint).holds(Pose(x, y, yaw)) == (room > 0.0)


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
