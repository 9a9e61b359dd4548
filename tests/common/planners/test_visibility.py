from __future__ import annotations

import numpy as np
import pytest

from common.config import MappingConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.thinning import cells_a_block
from common.planners.visibility import metres, observed, observed_by, subcells, unknown_in_sight
from tests.common.mapping.worlds import random_world, scan_of
from tests.common.planners.rollout import drawn
from tests.common.planners.worlds import CONFIG, ROOM, ROOMS, looked


def test_observed_frontiers_add_up_to_the_utility() -> None:
    mapper, _ = looked(ROOMS, [ROOMS.start, (14.0, 14.0)])
    seen = observed(mapper.belief, mapper.viewpoints, mapper.frontiers, CONFIG.observable_range)
    counts = seen.sum(axis=1)
    assert np.where(counts >= CONFIG.min_utility, counts, 0).tolist() == mapper.observe().utility.tolist()


@pytest.mark.parametrize(("resolution", "radius"), [(0.25, 0.0), (0.1, 0.0), (0.1, 0.2)])
def test_what_the_update_saw_is_what_lines_to_the_first_frontier_of_each_block_say(resolution, radius) -> None:
    rng = np.random.default_rng(4)
    config = MappingConfig(resolution=resolution, sensor_range=5.0, viewpoint_spacing=2.0, robot_radius=radius)
    free = random_world(rng, 60, 80)
    mapper = Mapper(config, lattice_origin=(0.3, 0.1))
    looks = 0
    for row, column in rng.permutation(np.argwhere(free))[:6]:
        pose = Pose((column + 0.5) * resolution, (row + 0.5) * resolution)
        mapper.integrate(scan_of(free, resolution, (0.0, 0.0), pose, range_max=5.0, beams=90), pose)
        mapper.update(pose)
        if mapper.stuck:
            continue
        frontiers, nodes = mapper.frontiers, rng.permutation(len(mapper.viewpoints))
        # Of the frontiers of a block the lowest row's first one comes first.
        side = cells_a_block(resolution)
        blocks = np.floor(np.rint((frontiers - mapper.lattice_origin) / resolution - 0.5) / side)
        firsts = np.array([int(np.flatnonzero((blocks == block).all(axis=1))[0]) for block in blocks])
        places = mapper.viewpoints[nodes]
        in_sight = observed(mapper.belief, places, frontiers[firsts], config.observable_range)
        for reach in (3.0, config.observable_range):
            near = np.hypot(*(places[:, None] - frontiers).transpose(2, 0, 1)) <= reach + 1e-9
            np.testing.assert_array_equal(observed_by(mapper, nodes, reach), in_sight & near)
        looks += int(in_sight.sum())
    assert looks > 100


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
