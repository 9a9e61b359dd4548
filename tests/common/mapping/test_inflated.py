import numpy as np
import pytest

from common.config.schema import MappingConfig
from common.errors import MappingError
from common.geometry import Pose
from common.mapping.inflated import InflatedMapper
from common.mapping.mapper import Mapper
from tests.common.mapping.worlds import random_world, see

CONFIG = MappingConfig(resolution=0.25, sensor_range=8.0, viewpoint_spacing=2.0, beacon_range=8.0)


def mappers(inflation, rows=60, columns=70):
    frame = {"lattice_origin": (1.0, 1.0), "bounds": (0.0, 0.0, 0.25 * columns, 0.25 * rows)}
    return InflatedMapper(CONFIG, inflation=inflation, **frame), Mapper(CONFIG, **frame)


def by_hand(cells, reach, robot, clear):
    """Free cells whose centre is nearer to an occupied cell than ``reach`` cells, the slow way."""
    out = cells.copy()
    occupied = np.argwhere(cells > 0)
    for row, column in np.argwhere(cells == 0):
        if max(abs(row - robot[0]), abs(column - robot[1])) <= clear or not len(occupied):
            continue
        gap = np.maximum(np.abs(occupied - (row, column)) - 0.5, 0.0)
        if np.hypot(*gap.T).min() < reach:
            out[row, column] = 100
    return out


@pytest.mark.parametrize(("inflation", "clear"), [(0.0, 0), (0.2, 1), (0.3, 2), (0.55, 3)])
def test_updates_along_a_way_make_the_same_as_thickening_the_whole_belief(inflation, clear):
    rng = np.random.default_rng(3)
    free = random_world(rng, 60, 70)
    thick, plain = mappers(inflation)
    places = np.argwhere(free)[rng.permutation(int(free.sum()))[:12]]
    for row, column in places.tolist():
        pose = Pose(0.25 * (column + 0.5), 0.25 * (row + 0.5))
        see(thick, free, pose)
        see(plain, free, pose)
        expected = by_hand(plain.belief.cells, inflation / 0.25, (row, column), clear)
        assert np.array_equal(thick.belief.cells, expected)
        assert thick.belief.known_cells == plain.belief.known_cells


def test_a_robot_keeps_away_from_walls_and_can_leave_them():
    free = np.ones((60, 70), dtype=bool)
    free[[0, -1], :] = free[:, [0, -1]] = False
    free[30:33, 20:50] = False
    thick, plain = mappers(0.3)
    # Right in front of the lower face of the wall.
    here = Pose(8.6, 7.4)
    for mapper in (thick, plain):
        see(mapper, free, here)
    along = ((6.1, 7.4), (11.1, 7.4))
    assert plain.segment_free(*along)
    assert not thick.segment_free(*along)
    assert thick.segment_free(here.position, (8.6, 4.0))
    assert not thick.stuck


def test_without_bounds_it_grows_with_what_is_seen():
    free = np.ones((60, 70), dtype=bool)
    free[[0, -1], :] = free[:, [0, -1]] = False
    growing = InflatedMapper(CONFIG, inflation=0.3, lattice_origin=(1.0, 1.0))
    fixed, _ = mappers(0.3)
    for place in ((3.1, 3.1), (13.1, 11.1), (3.1, 11.1)):
        see(growing, free, Pose(*place))
        see(fixed, free, Pose(*place))
    assert np.array_equal(growing.belief.window((0.0, 0.0), (60, 70)), fixed.belief.window((0.0, 0.0), (60, 70)))


def test_nonsense_is_refused():
    with pytest.raises(MappingError, match="robot's radius"):
        InflatedMapper(CONFIG, inflation=-0.1, lattice_origin=(0.0, 0.0))
