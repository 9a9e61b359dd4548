"""Which ways the nominal protocol lets a planner of free positions drive."""

from __future__ import annotations

import numpy as np
import pytest

from actors.protocol import check_way
from common.config import MappingConfig
from common.errors import HDError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from tests.common.mapping.worlds import see_all

CONFIG = MappingConfig(resolution=0.25, sensor_range=10.0, viewpoint_spacing=2.0, robot_radius=0.27)


def test_a_robot_leaves_a_nook_that_turned_out_to_be_too_narrow_by_the_way_home_alone() -> None:
    free = np.zeros((24, 24), dtype=np.bool_)
    free[2:12, 2:22] = True
    free[12, 11:13] = True  # a gap of half a metre
    free[13:15, 10:13] = True
    mapper = Mapper(CONFIG, lattice_origin=(2.0, 2.0))
    pose = Pose(2.88, 3.5)
    see_all(mapper, free, pose)
    home = mapper.way_home()
    assert not mapper.segment_free(pose.position, home[0]), "it comes nearer to the walls than the robot is"
    check_way(mapper, pose, home, CONFIG.viewpoint_spacing)
    check_way(mapper, pose, [*home, (home[-1][0] + 0.5, home[-1][1])], CONFIG.viewpoint_spacing)
    with pytest.raises(HDError, match="is not known to be free: choose"):
        check_way(mapper, pose, [(home[0][0], home[0][1] - 0.05)], CONFIG.viewpoint_spacing)
    with pytest.raises(HDError, match="is not known to be free: choose"):
        check_way(mapper, pose, [*home, (home[-1][0], 3.4)], CONFIG.viewpoint_spacing)
