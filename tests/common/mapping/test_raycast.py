from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.geometry import Pose
from common.mapping.raycast import SUBCELLS, cast_rays, to_subcells
from tests.common.mapping.reference import march
from tests.common.mapping.worlds import random_world, world_of

EAST, NORTH, WEST, SOUTH = 0.0, np.pi / 2, np.pi, 3 * np.pi / 2


def cast(free, x, y, *angles, resolution=0.5, origin=(0.0, 0.0), range_max=20.0):
    return cast_rays(free, resolution, *origin, x, y, np.array(angles, dtype=np.float64), range_max)


def test_walls_are_where_they_are_drawn():
    free = world_of("""
        ########
        #......#
        #......#
        ########""")
    ranges = cast(free, 1.0, 1.0, EAST, NORTH, WEST, SOUTH)
    np.testing.assert_allclose(ranges, [2.5, 0.5, 0.5, 0.5])
    assert ranges.dtype == np.float32


def test_the_origin_may_be_anywhere():
    free = np.ones((10, 10), dtype=np.bool_)
    ranges = cast(free, -98.0, 7.5, EAST, NORTH, WEST, SOUTH, origin=(-100.0, 5.0))
    np.testing.assert_allclose(ranges, [3.0, 2.5, 2.0, 2.5])


def test_outside_the_grid_everything_is_occupied():
    free = np.ones((4, 4), dtype=np.bool_)
    np.testing.assert_allclose(cast(free, 1.0, 1.0, EAST, NORTH), [1.0, 1.0])
    np.testing.assert_array_equal(cast(free, 5.0, 1.0, EAST, WEST), [0.0, 0.0])


def test_a_start_in_a_wall_sees_nothing_but_it():
    free = np.ones((4, 4), dtype=np.bool_)
    free[2, 2] = False
    np.testing.assert_array_equal(cast(free, 1.2, 1.2, EAST, WEST, 1.0), [0.0, 0.0, 0.0])


def test_nothing_within_range_is_infinite():
    free = np.ones((4, 100), dtype=np.bool_)
    assert np.isinf(cast(free, 1.0, 1.0, EAST, range_max=10.0)[0])
    assert np.isinf(cast(free, 40.0, 1.0, EAST, range_max=10.0)[0])  # the border is met at 10 m, not nearer
    assert cast(free, 40.5, 1.0, EAST, range_max=10.0)[0] == pytest.approx(9.5)


def test_a_ray_passes_one_corner_but_not_two():
    free = np.ones((8, 8), dtype=np.bool_)
    free[3, 4] = False
    diagonal = np.pi / 4
    assert cast(free, 0.5, 0.5, diagonal)[0] == pytest.approx(3.5 * 2**0.5)
    free[4, 3] = False
    assert cast(free, 0.5, 0.5, diagonal)[0] == pytest.approx(1.5 * 2**0.5)


def test_positions_on_cell_borders_do_not_slip_into_the_cell_before():
    assert to_subcells(130.0, 0.0, 0.25) == 520 * SUBCELLS
    for k in range(2000):
        assert to_subcells(0.1 * k, 0.0, 0.1) == k * SUBCELLS
        assert to_subcells(-13.7 + 0.2 * k, -13.7, 0.2) == k * SUBCELLS


@settings(max_examples=60, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), resolution=st.sampled_from([0.2, 0.25, 1.0]))
def test_ranges_agree_with_marching_in_small_steps(seed, resolution):
    rng = np.random.default_rng(seed)
    free = random_world(rng, 30, 30)
    row, column = rng.choice(np.argwhere(free)) + rng.uniform(0.1, 0.9, 2)
    pose = Pose(float(column * resolution), float(row * resolution))
    for angle in rng.uniform(-7, 7, 5):
        got = cast(free, pose.x, pose.y, angle, resolution=resolution, range_max=25 * resolution)[0]
        want = march(free, resolution, pose, angle, 25 * resolution)
        # A step may jump over a corner that the exact ray cuts, never the other way round.
        assert got <= want + 1e-4
        if got < want - 2e-3 * resolution:
            depth = corner_depth(free, resolution, pose, angle, float(got))
            assert depth < 2e-3, "the ray stopped at something thicker than a step"


def corner_depth(free, resolution, pose, angle, distance):
    """How far, in cells, a ray runs inside the occupied cell that it meets at a distance."""
    t = np.linspace(distance, distance + 0.02 * resolution, 2001) + 1e-7
    rows = np.floor((pose.y + np.sin(angle) * t) / resolution).astype(int)
    columns = np.floor((pose.x + np.cos(angle) * t) / resolution).astype(int)
    return float(np.count_nonzero(~free[rows.clip(0, 29), columns.clip(0, 29)]) * 1e-5)
