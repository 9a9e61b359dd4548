import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from actors.maps.connectivity import label_regions
from actors.maps.turning import turn, turned_resolution
from common.errors import MapError
from tests.plans import diagonal_corridor

RESOLUTION = 0.1
ORIGIN = (3.3, -2.1)


def old_cells(shape, resolution, corner, yaw):
    """Rows and columns of the old cells under the centres of a turned map's cells."""
    rows, columns = np.indices(shape)
    x = corner[0] + (columns + 0.5) * resolution - ORIGIN[0]
    y = corner[1] + (rows + 0.5) * resolution - ORIGIN[1]
    cosine, sine = math.cos(yaw), math.sin(yaw)
    return (
        np.floor((cosine * y - sine * x) / RESOLUTION).astype(int),
        np.floor((cosine * x + sine * y) / RESOLUTION).astype(int),
    )


masks = st.tuples(st.integers(1, 12), st.integers(1, 12)).flatmap(lambda shape: arrays(np.bool_, shape))


@settings(max_examples=300)
@given(masks, st.floats(-4.0, 4.0))
def test_nothing_is_lost_and_regions_stay_what_they_are(free, yaw) -> None:
    if not free.any():
        free[0, 0] = True
    turned, resolution, corner = turn(free, RESOLUTION, ORIGIN, yaw)
    assert resolution == turned_resolution(RESOLUTION, yaw)
    rows, columns = old_cells(turned.shape, resolution, corner, yaw)
    rows, columns = rows[turned], columns[turned]
    # Every old free cell is there, and nothing else is.
    seen = np.zeros_like(free)
    seen[np.clip(rows, 0, free.shape[0] - 1), np.clip(columns, 0, free.shape[1] - 1)] = True
    if resolution != RESOLUTION:
        assert np.array_equal(seen, free)
    # Regions of the new map and of the old one are the same regions.
    old, new = label_regions(free)[0], label_regions(turned)
    if resolution != RESOLUTION:
        pairs = set(zip(old[rows, columns].tolist(), new[0][turned].tolist(), strict=True))
        assert len(pairs) == len({pair[0] for pair in pairs}) == len({pair[1] for pair in pairs}) == old.max()
    else:
        assert new[1] == old.max() and np.count_nonzero(turned) == np.count_nonzero(free)


@pytest.mark.parametrize("quarters", range(-4, 5))
def test_right_angles_resample_nothing(quarters) -> None:
    free = np.random.default_rng(1).random((5, 9)) < 0.5
    turned, resolution, _ = turn(free, RESOLUTION, ORIGIN, quarters * math.pi / 2 + 1e-6)
    assert resolution == RESOLUTION and np.array_equal(turned, np.rot90(free, -quarters))


def test_turned_forth_and_back_a_plan_keeps_its_area_and_its_rooms() -> None:
    plan = diagonal_corridor()
    for yaw in (0.3, math.pi / 4, -1.1):
        turned, fine, corner = turn(plan.world.free, RESOLUTION, (0.0, 0.0), yaw)
        area = np.count_nonzero(turned) * fine**2
        assert area == pytest.approx(plan.world.free_area, rel=0.005)
        back, finer, low = turn(turned, fine, corner, -yaw)
        labels, count = label_regions(back)
        assert count == 1 and finer == RESOLUTION / 4
        for x, y in plan.rooms.values():
            # The second turn is about the corner of the turned map.
            cosine, sine = math.cos(yaw), math.sin(yaw)
            from_corner = np.array([cosine * x - sine * y - corner[0], sine * x + cosine * y - corner[1]])
            column, row = np.array([[cosine, sine], [-sine, cosine]]) @ from_corner + corner - low
            assert labels[int(row / finer), int(column / finer)] == 1


def test_what_would_be_too_large_is_refused() -> None:
    with pytest.raises(MapError, match="at most 16384 on a side are allowed: crop the image"):
        turn(np.ones((6000, 6000), dtype=np.bool_), 0.05, (0.0, 0.0), 0.7)


def test_walls_around_are_cropped_and_empty_maps_stay_empty() -> None:
    free = np.zeros((400, 400), dtype=np.bool_)
    assert not turn(free, 0.1, (0.0, 0.0), 0.5)[0].any()
    free[200:210, 100:120] = True
    assert max(turn(free, 0.1, (0.0, 0.0), 0.5)[0].shape) < 60
