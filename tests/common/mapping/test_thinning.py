"""Blocks of frontier cells, and what thinning must not change: when an exploration is complete."""

from __future__ import annotations

from itertools import chain

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config import MappingConfig
from common.geometry import Pose
from common.mapping.belief import Belief
from common.mapping.mapper import Mapper
from common.mapping.thinning import block_at, blocks_of, cells_a_block, list_block
from common.planners.visibility import observed
from tests.common.mapping.worlds import random_world, scan_of


@pytest.mark.parametrize(
    ("resolution", "side"), [(1.0, 1), (0.5, 1), (0.25, 1), (0.2, 1), (0.125, 2), (0.1, 3), (0.05, 5), (0.02, 13)]
)
def test_blocks_are_a_quarter_of_a_metre_and_cells_from_there_on_their_own(resolution, side):
    assert cells_a_block(resolution) == side


@given(
    side=st.integers(1, 5),
    corner=st.tuples(st.integers(-20, 20), st.integers(-20, 20)),
    shape=st.tuples(st.integers(1, 20), st.integers(1, 20)),
    seed=st.integers(0, 99),
)
@settings(max_examples=50, deadline=None, derandomize=True)
def test_every_frontier_lies_in_one_block_that_lies_still_when_the_grid_grows(side, corner, shape, seed):
    mask = np.random.default_rng(seed).random(shape) < 0.3
    groups = set()
    for grow in (0, 1, 7):
        x, y = corner[1] - grow, corner[0] - grow
        belief = Belief(1.0, 5.0, anchor=(0.0, 0.0))
        belief.assign(np.zeros((shape[0] + 2 * grow, shape[1] + 2 * grow), dtype=np.int8), (x, y))
        padded = np.zeros(belief.padded.shape, dtype=np.bool_)
        row, column = belief.cell((corner[1] + 0.5, corner[0] + 0.5))
        padded[row + 1 : row + 1 + shape[0], column + 1 : column + 1 + shape[1]] = mask
        blocks, width = blocks_of(belief, side), padded.shape[1]
        cells = np.empty(side * side, dtype=np.int32)
        found = []
        for block in range(blocks.rows * blocks.columns):
            count = list_block(padded.reshape(-1), width, blocks, block, cells)
            assert all(block_at(blocks, cell, width) == block for cell in cells[:count])
            found.append([(c // width - row - 1, c % width - column - 1) for c in cells[:count].tolist()])
        assert sorted(chain.from_iterable(found)) == [tuple(each) for each in np.argwhere(mask).tolist()]
        groups.add(tuple(sorted(tuple(each) for each in found if each)))
    assert len(groups) == 1


@settings(max_examples=15, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 2**32 - 1),
    resolution=st.sampled_from([0.05, 0.1]),
    radius=st.sampled_from([0.0, 0.2]),
    least=st.integers(1, 4),
)
def test_nothing_is_left_only_where_no_viewpoint_observes_enough_of_all_frontiers(seed, resolution, radius, least):
    """Robots that go wherever something is left, until the end: there all frontiers were looked at, one by one."""
    rng = np.random.default_rng(seed)
    free = random_world(rng, 40, 50)
    config = MappingConfig(
        resolution=resolution,
        sensor_range=2.0,
        viewpoint_spacing=8 * resolution,
        beacon_range=3.0,
        robot_radius=radius * resolution / 0.1,
        min_utility=least,
        least_utility=least,
    )
    mapper = Mapper(config, lattice_origin=(0.0, 0.0))
    row, column = rng.choice(np.argwhere(free))
    pose = Pose(float(column + 0.5) * resolution, float(row + 0.5) * resolution)
    for _ in range(60):
        mapper.integrate(scan_of(free, resolution, (0.0, 0.0), pose, range_max=2.0, beams=90), pose)
        mapper.update(pose)
        if mapper.stuck:
            return
        observation = mapper.observe()
        left = np.flatnonzero((observation.utility > 0) & ~observation.visited)
        if not len(left):
            seen = observed(mapper.belief, mapper.viewpoints, mapper.frontiers, config.observable_range).sum(axis=1)
            assert (seen[~observation.visited] < least).all()
            return
        pose = Pose(*mapper.position(int(rng.choice(left))))
