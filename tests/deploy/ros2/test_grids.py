import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from common.geometry import Pose
from deploy.ros2 import conversions as convert
from deploy.ros2.errors import RosError
from deploy.ros2.messages import message
from tests.deploy.ros2.wire import close, few, over_the_wire, poses


@few
@given(
    hnp.arrays(np.int8, st.tuples(st.integers(0, 12), st.integers(0, 12)), elements=st.integers(-128, 127)),
    st.floats(0.0078125, 2.0, width=32),
    poses,
)
def test_grids_round_trip(cells, resolution, corner):
    there = over_the_wire(
        convert.occupancy_grid(1.0, "map", cells, resolution, (corner.x, corner.y, corner.yaw)),
        "nav_msgs/msg/OccupancyGrid",
    )
    back, size, (x, y, yaw) = convert.grid_from(there)
    assert np.array_equal(back, cells)
    assert size == resolution
    assert close(Pose(x, y, yaw), corner)


@pytest.mark.parametrize(("field", "value"), [("width", 99), ("height", 2**31), ("resolution", 0.0)])
def test_grids_that_lie_are_refused(field, value):
    grid = convert.occupancy_grid(1.0, "map", np.zeros((3, 4), np.int8), 0.1)
    setattr(grid.info, field, value)
    with pytest.raises(RosError, match="OccupancyGrid"):
        convert.grid_from(grid)


def test_grids_of_cells_beyond_reason_are_refused_by_name():
    with pytest.raises(RosError, match="resolution"):
        convert.grid_from(convert.occupancy_grid(1.0, "map", np.zeros((2, 2), np.int8), 1e4))


@pytest.mark.parametrize(("z", "w"), [(1.57, 0.0), (1.57, 1.0), (90.0, 1.0), (math.nan, 1.0)])
def test_a_yaw_in_the_place_of_a_quaternion_is_refused(z, w):
    grid = convert.occupancy_grid(1.0, "map", np.zeros((2, 3), np.int8), 0.5, (1.0, 2.0, 0.5))
    grid.info.origin.orientation = message("geometry_msgs/msg/Quaternion", z=z, w=w)
    with pytest.raises(RosError, match=r"length 1, got .*a yaw in radians is"):
        convert.grid_from(grid)


def test_a_map_whose_rotation_was_never_set_is_not_turned():
    grid = convert.occupancy_grid(1.0, "map", np.zeros((2, 3), np.int8), 0.5, (1.0, 2.0, 0.5))
    grid.info.origin.orientation = message("geometry_msgs/msg/Quaternion")
    grid.info.origin.orientation.w = 0.0
    assert convert.grid_from(grid)[2] == (1.0, 2.0, 0.0)
