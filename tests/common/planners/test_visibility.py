from __future__ import annotations

import numpy as np
import pytest

from common.planners.visibility import metres, observed, subcells, unknown_in_sight
from tests.common.planners.rollout import drawn
from tests.common.planners.worlds import CONFIG, ROOM, ROOMS, looked


def test_observed_frontiers_add_up_to_the_utility() -> None:
    mapper, _ = looked(ROOMS, [ROOMS.start, (14.0, 14.0)])
    seen = observed(mapper.belief, mapper.viewpoints, mapper.frontiers, CONFIG.observable_range)
    counts = seen.sum(axis=1)
    assert np.where(counts >= CONFIG.min_utility, counts, 0).tolist() == mapper.observe().utility.tolist()


def test_subcells_and_back() -> None:
    mapper, _ = looked(ROOMS)
    points = np.array([[3.25, 7.5], [10.0, 11.125]])
    assert metres(mapper.belief, subcells(mapper.belief, points)) == pytest.approx(points)


def test_nothing_unknown_in_a_closed_room() -> None:
    mapper, pose = looked(ROOM)
    assert unknown_in_sight(mapper, np.array([pose.position]), 10.0) == pytest.approx([0.0])


def test_unknown_area_of_an_open_plain() -> None:
    # The robot saw a disc of 10 m around it: from its middle, 20 m of sensor would see the ring around that.
    plain = drawn([*["." * 14] * 6, "......S.......", *["." * 14] * 6])
    mapper, pose = looked(plain)
    area = unknown_in_sight(mapper, np.array([pose.position]), 20.0)[0]
    assert area == pytest.approx(np.pi * (20.0**2 - 10.0**2), rel=0.15)
    assert unknown_in_sight(mapper, np.array([pose.position]), 9.0)[0] == 0.0


def test_walls_hide_the_unknown() -> None:
    mapper, _ = looked(ROOMS)
    known = mapper.viewpoints
    areas = unknown_in_sight(mapper, known, 10.0)
    assert areas.max() > 0.0
    assert (areas <= np.pi * 10.0**2).all()
