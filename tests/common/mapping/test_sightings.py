"""Which viewpoint observes which frontier cell, against lines of sight drawn anew."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config import MappingConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.visibility import observed
from tests.common.mapping.worlds import random_world, scan_of


@settings(max_examples=20, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), spacing=st.sampled_from([1.0, 2.0]), utility_range=st.sampled_from([None, 3.0]))
def test_sightings_are_what_is_in_range_and_in_sight(seed: int, spacing: float, utility_range: float | None) -> None:
    rng = np.random.default_rng(seed)
    config = MappingConfig(
        resolution=0.25, sensor_range=5.0, viewpoint_spacing=spacing, beacon_range=5.0, utility_range=utility_range
    )
    free = random_world(rng, 40, 48)
    mapper = Mapper(config, lattice_origin=(0.3, 0.1))
    for row, column in rng.permutation(np.argwhere(free))[:5]:
        pose = Pose(float(column + 0.5) * 0.25, float(row + 0.5) * 0.25)
        mapper.integrate(scan_of(free, 0.25, (0.0, 0.0), pose, range_max=5.0, beams=90), pose)
        mapper.update(pose)
        pointer, seen = mapper.sightings()
        assert len(pointer) == len(mapper.viewpoints) + 1
        assert pointer[0] == 0
        assert pointer[-1] == len(seen)
        if mapper.stuck:
            continue
        expected = observed(mapper.belief, mapper.viewpoints, mapper.frontiers, config.observable_range)
        for node, row_seen in enumerate(expected):
            assert seen[pointer[node] : pointer[node + 1]].tolist() == np.flatnonzero(row_seen).tolist()


def test_edges_are_as_long_as_the_ways_over_them() -> None:
    free = np.ones((40, 40), dtype=np.bool_)
    mapper = Mapper(MappingConfig(resolution=0.25, sensor_range=5.0, viewpoint_spacing=2.0), lattice_origin=(0.0, 0.0))
    pose = Pose(5.0, 5.0)
    mapper.integrate(scan_of(free, 0.25, (0.0, 0.0), pose, range_max=5.0, beams=360), pose)
    mapper.update(pose)
    edges = mapper.adjacency
    assert len(edges.neighbours) > 40
    for a in range(len(mapper.viewpoints)):
        for entry in range(edges.pointer[a], edges.pointer[a + 1]):
            assert edges.lengths[entry] == pytest.approx(mapper.distances(a)[edges.neighbours[entry]])
