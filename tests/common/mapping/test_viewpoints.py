"""Where viewpoints are, in worlds small enough to check by eye."""

from __future__ import annotations

import numpy as np

from common.geometry import Pose
from common.mapping.mapper import Mapper
from tests.common.mapping.worlds import small_config


def test_a_viewpoint_beside_its_lattice_point_keeps_away_from_a_wall_in_the_next_square():
    # Squares of 8 cells; the lower right quarter of the left one is free, and so is what lies right of it.
    mapper = Mapper(small_config(viewpoint_spacing=4.0, resolution=0.25), lattice_origin=(2.0, 2.0))
    cells = np.full((16, 32), 100, dtype=np.int8)
    cells[1:7, 14:24] = 0
    mapper.belief.assign(cells, (0.0, 0.0))
    mapper.update(Pose(3.9, 1.0))
    assert mapper.position(mapper.robot) == (3.875, 1.375)
    cells[1:7, 16] = 100
    mapper.belief.assign(cells[1:7, 16:17], (4.0, 0.25))
    mapper.update(Pose(3.9, 1.0))
    assert mapper.position(mapper.robot) == (3.625, 1.625)


def test_a_first_look_far_from_an_empty_belief_grows_it():
    mapper = Mapper(small_config(), lattice_origin=(1.0, 1.0))
    mapper.update(Pose(40.0, 40.0))
    assert mapper.stuck
    mapper.belief.assign(np.zeros((20, 20), dtype=np.int8), (35.0, 35.0))
    mapper.update(Pose(40.0, 40.0))
    assert not mapper.stuck
