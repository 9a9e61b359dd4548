"""Ways along edges and to the target."""

from __future__ import annotations

import numpy as np
import pytest

from common.errors import MappingError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from tests.common.mapping.worlds import see_all, small_config


def test_there_is_no_way_to_the_target_from_a_viewpoint_without_a_link_to_it():
    free = np.ones((24, 24), dtype=np.bool_)
    free[[0, -1], :] = free[:, [0, -1]] = False
    free[:18, 12] = False  # a wall with a way round at the top
    mapper = Mapper(small_config(), lattice_origin=(1.0, 1.0), target=(9.3, 2.9))
    see_all(mapper, free, Pose(5.0, 3.0))
    target = mapper.observe().viewpoints
    with pytest.raises(MappingError, match="no link to the target"):
        mapper.way(mapper.robot, target)
    path = mapper.path(mapper.robot, target)
    assert mapper.way(path[-2], target) == [(9.3, 2.9)]
