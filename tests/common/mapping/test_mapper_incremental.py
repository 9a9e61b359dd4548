"""What an update makes of changes equals what a new mapper makes of the whole belief."""

from __future__ import annotations

from math import ceil

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config import MappingConfig
from common.errors import MappingError
from common.geometry import Pose, Scan
from common.mapping.mapper import Mapper
from tests.common.mapping.worlds import random_world, scan_of

OBSERVED = (
    "offsets",
    "utility",
    "visited",
    "beacon",
    "degree",
    "neighbours",
    "bent",
    "bent_length",
    "robot",
    "target_known",
    "target_offset",
    "target_links",
)


class Pair:
    """A mapper, and how to make a new one of what it knows; its grid must not grow between two updates."""

    def __init__(self, config: MappingConfig, **arguments) -> None:
        self.config, self.arguments = config, arguments
        self.mapper = Mapper(config, **arguments)

    def update(self, pose: Pose) -> None:
        """Update the mapper, and assert that a new one which is told where the robot has been comes to the same."""
        mapper = self.mapper
        been = mapper._graph.cells.been.copy()
        mapper.update(pose)
        fresh = Mapper(self.config, **self.arguments)
        fresh.belief.assign(mapper.belief.cells, mapper.belief.origin)
        fresh._rebuild(None)
        fresh._graph.cells.been[:] = been
        fresh.update(pose)
        assert_same(mapper, fresh)


def everything(mapper: Mapper) -> dict[tuple[int, int], int]:
    """All viewpoints, reachable or not, and how many frontiers they observe."""
    pieces = mapper._graph.pieces
    existing = np.flatnonzero(pieces["exists"])
    return {(int(pieces["x"][k]), int(pieces["y"][k])): int(mapper._utility.counts[k]) for k in existing}


def assert_same(mapper: Mapper, fresh: Mapper) -> None:
    np.testing.assert_array_equal(mapper.frontiers, fresh.frontiers)
    assert everything(mapper) == everything(fresh)
    assert mapper.explored_area == fresh.explored_area
    assert mapper.stuck == fresh.stuck
    np.testing.assert_array_equal(mapper.clear.padded, fresh.clear.padded)
    np.testing.assert_array_equal(mapper.viewpoints, fresh.viewpoints)
    for name in ("pointer", "neighbours", "lengths", "bent"):
        np.testing.assert_array_equal(getattr(mapper.adjacency, name), getattr(fresh.adjacency, name), err_msg=name)
    for kind in range(2):
        np.testing.assert_array_equal(mapper.sightings()[kind], fresh.sightings()[kind])
    if not mapper.stuck:
        for name in OBSERVED:
            np.testing.assert_array_equal(getattr(mapper.observe(), name), getattr(fresh.observe(), name), err_msg=name)


def test_every_single_cell_may_come_and_go():
    """Each cell in turn becomes a wall, unknown or free, and then again what it was."""
    config = MappingConfig(resolution=0.5, sensor_range=4.0, viewpoint_spacing=2.0, beacon_range=4.0)
    cells = np.zeros((11, 12), dtype=np.int8)
    cells[6:, 8:] = -1
    cells[3:8, 4] = 100
    pair = Pair(config, lattice_origin=(0.0, 0.0), bounds=(0.0, 0.0, 6.0, 5.5))
    pair.mapper.belief.assign(cells, (0.0, 0.0))
    pair.update(Pose(3.0, 4.0))
    for row, column in np.ndindex(cells.shape):
        before = int(cells[row, column])
        for value in {100, -1, 0} - {before}, {before}:
            for each in sorted(value):
                pair.mapper.belief.assign(np.array([[each]], dtype=np.int8), (0.5 * column, 0.5 * row))
                pair.update(Pose(3.0, 4.0))


@settings(max_examples=20, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 2**32 - 1),
    resolution=st.sampled_from([0.1, 0.2, 0.25]),
    spacing=st.sampled_from([1.0, 1.7, 3.0]),
    radius=st.sampled_from([0.0, 0.15, 0.25, 0.4]),
    noise=st.sampled_from([0.0, 0.1, 0.5]),
)
def test_an_update_equals_a_new_start(seed, resolution, spacing, radius, noise):
    """Whatever is seen: true scans and patches of noise; the robot is anywhere in what it believes to be free."""
    rng = np.random.default_rng(seed)
    free = random_world(rng, 45, 60)
    height, width = (number * resolution for number in free.shape)
    config = MappingConfig(
        resolution=resolution, sensor_range=6.0, viewpoint_spacing=spacing, beacon_range=5.0, robot_radius=radius
    )
    pair = Pair(
        config,
        lattice_origin=(float(rng.uniform(0.0, spacing)), float(rng.uniform(0.0, spacing))),
        bounds=(-1.0, -1.0, width + 1.0, height + 1.0),
        target=(float(rng.uniform(0.0, width)), float(rng.uniform(0.0, height))),
    )
    belief = pair.mapper.belief
    places = np.argwhere(free)
    row, column = rng.choice(places)
    for _ in range(12):
        pose = Pose(float(column + rng.random()) * resolution, float(row + rng.random()) * resolution)
        pair.mapper.belief.integrate(scan_of(free, resolution, (0.0, 0.0), pose, range_max=6.0, beams=180), pose)
        if noise:
            patch = rng.choice(np.array([-1, 0, 100], dtype=np.int8), tuple(rng.integers(1, ceil(90 * noise) + 1, 2)))
            top, left = (int(rng.integers(0, n - p + 1)) for n, p in zip(free.shape, patch.shape, strict=True))
            belief.assign(patch, (left * resolution, top * resolution))
        pair.update(pose)
        known = np.argwhere(belief.window((0.0, 0.0), free.shape) == 0)
        row, column = rng.choice(known) if len(known) else rng.choice(places)


@pytest.mark.parametrize("radius", [0.0, 0.25])
def test_half_of_all_cells_may_be_walls(radius):
    rng = np.random.default_rng(11)
    config = MappingConfig(resolution=0.1, sensor_range=6.0, viewpoint_spacing=2.0, robot_radius=radius)
    pair = Pair(config, lattice_origin=(0.0, 0.0), bounds=(0.0, 0.0, 16.0, 12.0))
    for share in (0.5, 0.02, 0.5, 0.1):
        cells = np.where(rng.random((120, 160)) < share, 100, 0).astype(np.int8)
        cells[55:65, 75:85] = 0
        pair.mapper.belief.assign(cells, (0.0, 0.0))
        pair.update(Pose(8.0, 6.0))
        assert not pair.mapper.stuck


@pytest.mark.parametrize("junk", [np.nan, np.inf, -np.inf, 1e300, -1e300, 1e18, -1e18, 1e7])
def test_positions_that_make_no_sense_are_refused_and_change_nothing(junk):
    config = MappingConfig(resolution=0.5, sensor_range=4.0, viewpoint_spacing=2.0)
    pair = Pair(config, lattice_origin=(0.0, 0.0), bounds=(0.0, 0.0, 10.0, 10.0))
    free = np.ones((20, 20), dtype=np.bool_)
    for target in ((junk, 1.0), (1.0, junk)):
        with pytest.raises(MappingError, match="target must be finite and within 1000 km of"):
            Mapper(config, lattice_origin=(0.0, 0.0), target=target)
        with pytest.raises(MappingError, match="target must be finite and within 1000 km of"):
            pair.mapper.target = target
        with pytest.raises(MappingError, match="pose must be finite and within 1000 km of"):
            pair.mapper.update(Pose(*target))
        with pytest.raises(MappingError):
            pair.mapper.integrate(Scan(np.ones(4, dtype=np.float32), 0.0, 1.0, 4.0), Pose(*target))
    pair.mapper.integrate(scan_of(free, 0.5, (0.0, 0.0), Pose(5.0, 5.0)), Pose(5.0, 5.0))
    pair.update(Pose(5.0, 5.0))
    assert not pair.mapper.stuck


def test_the_farthest_target_is_tied_to_the_beacon_that_is_nearest_to_it():
    config = MappingConfig(resolution=0.05, sensor_range=2.0, viewpoint_spacing=0.5, beacon_range=1.0)
    mapper = Mapper(config, lattice_origin=(0.0, 0.0), target=(9e5, 9e5))
    mapper.belief.assign(np.zeros((120, 120), dtype=np.int8), (-3.0, -3.0))
    mapper.update(Pose(0.0, 0.0))
    assert np.count_nonzero(mapper.observe().beacon) > 20
    links = mapper.viewpoints[mapper.observe().target_links]
    others = mapper.viewpoints[
        mapper.observe().beacon & ~np.isin(np.arange(len(mapper.viewpoints)), mapper.observe().target_links)
    ]
    assert links.sum(axis=1).min() >= others.sum(axis=1).max() - 1e-6
    assert mapper.distances(mapper.robot)[-1] == pytest.approx(9e5 * 2**0.5, rel=1e-5)
