import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from actors.simulators.clearance import clearance, nearest_clear
from common.errors import SimulatorError
from tests.actors.simulators.worlds import RESOLUTION, block, hall, make_world


@given(
    free=arrays(np.bool_, (7, 9)),
    x=st.floats(0.0, 2.24),
    y=st.floats(0.0, 1.74),
    reach=st.sampled_from([0.2, 0.3, 0.6]),
)
def test_clearance_is_the_distance_to_the_nearest_occupied_cell(free, x, y, reach):
    world = make_world(free)
    nearest = reach
    for row in range(-4, 12):
        for column in range(-4, 14):
            if 0 <= row < 7 and 0 <= column < 9 and free[row, column]:
                continue
            dx = max(column * RESOLUTION - x, 0.0, x - (column + 1) * RESOLUTION)
            dy = max(row * RESOLUTION - y, 0.0, y - (row + 1) * RESOLUTION)
            nearest = min(nearest, float(np.hypot(dx, dy)))
    assert clearance(world, (x, y), reach) == pytest.approx(nearest, abs=1e-9)


def test_the_nearest_place_with_room_is_found():
    world = block(hall(), 6.0, 4.0, 0.25, 3.0)
    assert nearest_clear(world, (3.0, 3.0), 0.28) == (3.0, 3.0)
    x, y = nearest_clear(world, (5.95, 5.0), 0.28)
    assert clearance(world, (x, y), 0.28) >= 0.28
    assert x < 6.0
    assert np.hypot(x - 5.95, y - 5.0) < 0.5


def test_no_room_is_an_error():
    free = np.zeros((60, 60), dtype=np.bool_)
    free[:, 30] = True
    with pytest.raises(SimulatorError, match="no room"):
        nearest_clear(make_world(free), (7.6, 7.6), 0.28)
