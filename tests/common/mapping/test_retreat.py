"""A robot in clear space that its map cuts off."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.protocol import check_way
from common.config import MappingConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.track import Track
from common.planners.base import Status
from common.planners.registry import make_planner
from tests.common.mapping.worlds import scan_of

CONFIG = MappingConfig(resolution=0.25, sensor_range=6.0, viewpoint_spacing=2.0, robot_radius=0.27)
NOOK = Pose(3.0, 4.3)


def world() -> np.ndarray:
    """A long room, and a nook above its beginning behind a gap that is as wide as the robot."""
    free = np.zeros((24, 120), dtype=np.bool_)
    free[2:12, 2:118] = True
    free[12, 11:13] = True
    free[13:20, 8:16] = True
    return free


def walked(*, poses: list[Pose], target: tuple[float, float] | None = None) -> Mapper:
    """The mapper of a robot that has scanned at each pose and stands at the last."""
    mapper = Mapper(CONFIG, lattice_origin=(2.0, 2.0), target=target)
    for pose in poses:
        scan = scan_of(world(), CONFIG.resolution, (0.0, 0.0), pose, range_max=CONFIG.sensor_range, beams=720)
        mapper.integrate(scan, pose)
        mapper.update(pose)
    return mapper


INTO_NOOK = [Pose(2.5, 1.5), *(Pose(3.0, y) for y in np.arange(1.5, NOOK.y, 0.2)), NOOK]


def test_a_robot_behind_a_gap_that_became_too_narrow_goes_back_to_what_is_left_to_explore() -> None:
    mapper = walked(poses=INTO_NOOK)
    observation = mapper.observe()
    assert observation.utility.any(), "most of the room is unseen"
    assert mapper.position(mapper.robot)[1] < 3.0, "the robot counts as standing in the room"
    home = mapper.way_home()
    in_gap = [place for place in home if 2.6 < place[1] < 3.6]
    assert in_gap, "it is led through the gap"
    np.testing.assert_allclose(in_gap, [(3.0, y) for _, y in in_gap], atol=0.15)
    check_way(mapper, NOOK, home, CONFIG.viewpoint_spacing)


@pytest.mark.parametrize("name", ["nearest", "tour", "greedy"])
def test_no_planner_says_complete_there(name: str) -> None:
    mapper = walked(poses=INTO_NOOK)
    plan = make_planner(name, CONFIG).plan(mapper, NOOK)
    assert plan.status is Status.GOING
    check_way(mapper, NOOK, [*plan.via, plan.waypoint], CONFIG.viewpoint_spacing)


def test_a_robot_that_was_shut_in_says_so_and_goes_on_when_the_door_opens() -> None:
    mapper = walked(poses=INTO_NOOK)
    gap = np.zeros((1, 2), dtype=np.int8)
    mapper.belief.assign(gap + 100, (2.75, 3.0))
    mapper.update(NOOK)
    plan = make_planner("nearest", CONFIG).plan(mapper, NOOK)
    assert plan.status is Status.STUCK
    assert "its way back is closed" in plan.reason
    mapper.belief.assign(gap, (2.75, 3.0))
    mapper.update(NOOK)
    assert mapper.cut_off is None
    assert make_planner("nearest", CONFIG).plan(mapper, NOOK).status is Status.GOING


def test_without_a_track_there_is_no_way_out() -> None:
    mapper = walked(poses=INTO_NOOK[-1:])
    assert mapper.position(mapper.robot)[1] > 3.0


def test_a_robot_stays_where_nothing_else_is_left() -> None:
    through = [Pose(float(x), 1.75) for x in np.arange(28.0, 2.0, -2.0)]
    mapper = walked(poses=[*through, *INTO_NOOK])
    assert mapper.position(mapper.robot)[1] > 3.0
    assert not mapper.observe().beacon.any()


def test_a_robot_goes_back_to_its_target() -> None:
    through = [Pose(float(x), 1.75) for x in np.arange(28.0, 2.0, -2.0)]
    mapper = walked(poses=[*through, *INTO_NOOK], target=(25.0, 1.5))
    assert mapper.target_known
    assert mapper.path(mapper.robot, len(mapper.viewpoints))


@given(st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50)), min_size=1, max_size=40), st.floats(0.05, 2.0))
def test_the_way_back_along_a_track_stays_on_it(places: list[tuple[float, float]], step: float) -> None:
    track = Track(step)
    for place in places:
        track.add(place)
    known = track.places
    assert (np.hypot(*np.diff(known, axis=0).T) >= step).all()
    way = np.array(track.back(len(known) - 1, 0))
    np.testing.assert_array_equal(way[[0, -1]], known[[-1, 0]])
    for place in known:
        nearest = min(_gap(place, a, b) for a, b in pairwise(way)) if len(way) > 1 else 0.0
        assert nearest <= step / 2 + 1e-9


def _gap(place: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    along = b - a
    share = np.clip((place - a) @ along / (along @ along), 0.0, 1.0)
    return float(np.hypot(*(place - a - share * along)))
