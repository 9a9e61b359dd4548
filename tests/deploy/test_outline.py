"""Outlines of robots that are not round."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import ConfigError
from deploy.outline import circumscribed_radius, edges_of, inscribed_radius
from deploy.profiles import load_deploy_config

LONG = ((0.5, 0.2), (-0.4, 0.2), (-0.4, -0.2), (0.5, -0.2))


def test_radii_of_a_rectangle():
    assert inscribed_radius(LONG) == pytest.approx(0.2)
    assert circumscribed_radius(LONG) == pytest.approx(math.hypot(0.5, 0.2))
    assert set(edges_of(LONG)) == set(edges_of(LONG[::-1])) == {(1, 0, 0.5), (-1, 0, 0.4), (0, 1, 0.2), (0, -1, 0.2)}


@given(st.integers(3, 12), st.floats(0.1, 2.0), st.floats(0.0, 6.28), st.floats(0.0, 6.28))
def test_a_regular_polygon_lies_between_its_circles(count, radius, turn, direction):
    corners = [
        (radius * math.cos(turn + math.tau * k / count), radius * math.sin(turn + math.tau * k / count))
        for k in range(count)
    ]
    assert circumscribed_radius(corners) == pytest.approx(radius)
    assert inscribed_radius(corners) == pytest.approx(radius * math.cos(math.pi / count))
    x, y = math.cos(direction), math.sin(direction)
    # Along any ray the outline ends between the two circles.
    end = min(offset / (nx * x + ny * y) for nx, ny, offset in edges_of(corners) if nx * x + ny * y > 1e-9)
    assert inscribed_radius(corners) - 1e-9 <= end <= radius + 1e-9


@pytest.mark.parametrize(
    ("corners", "message"),
    [
        ("[[1, 0], [0, 1]]", "at least 3 corners"),
        ("[[1, 0], [0, 1], [-1, 0], [0, 0.2], [0, -1]]", "convex"),
        ("[[1, 1], [2, 1], [2, 2]]", "must contain"),
        ("[[1, 0], [1, 0], [0, 1], [-1, -1]]", "the same"),
    ],
)
def test_what_is_no_outline_is_refused(corners, message):
    with pytest.raises(ConfigError, match=message):
        load_deploy_config(overrides=[f"driving.footprint={corners}"])


def test_the_graph_keeps_room_for_the_whole_robot_unless_told_otherwise():
    footprint = f"driving.footprint={[list(corner) for corner in LONG]}"
    config = load_deploy_config(overrides=[footprint])
    assert config.driving.robot_radius == pytest.approx(0.2)
    assert config.mapping.robot_radius == pytest.approx(math.hypot(0.5, 0.2) + config.driving.clearance)
    # The watchdog gets the resolved tree, and must read it.
    assert type(config).model_validate_json(config.model_dump_json()) == config
    narrow = load_deploy_config(overrides=[footprint, "mapping.robot_radius=0.3"])
    assert narrow.mapping.robot_radius == 0.3
    with pytest.raises(ConfigError, match="largest circle within the footprint"):
        load_deploy_config(overrides=[footprint, "driving.robot_radius=0.3"])
