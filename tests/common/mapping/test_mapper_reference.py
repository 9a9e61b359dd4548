"""The mapper against the reference: equal after every step, whatever the world, the walk and the scans."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from common.config.schema import MappingConfig
from common.geometry import Pose, Scan
from common.mapping.mapper import Mapper
from tests.common.mapping.reference import ReferenceMapper
from tests.common.mapping.worlds import random_world, scan_of

SETTINGS = settings(max_examples=25, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])


def assert_same(mapper: Mapper, reference: ReferenceMapper) -> None:
    belief = mapper.belief
    first_row, first_column = belief.first_cell
    rows, columns = np.nonzero(belief.cells != -1)
    known = {
        (int(r) + first_row, int(c) + first_column): int(belief.cells[r, c]) for r, c in zip(rows, columns, strict=True)
    }
    assert known == reference.cells
    assert belief.known_cells == len(known)
    free = sum(value == 0 for value in known.values())
    assert mapper.explored_area == pytest.approx(free * belief.resolution**2)

    rows, columns = np.nonzero(mapper._frontiers.mask)
    assert list(zip((rows + first_row).tolist(), (columns + first_column).tolist(), strict=True)) == (
        reference.all_frontiers
    )
    graph = mapper._graph
    i, j = graph.first
    rows, columns = np.nonzero(graph.exists)
    viewpoints = [(int(c) + i, int(r) + j) for r, c in zip(rows, columns, strict=True)]
    assert viewpoints == reference.all_viewpoints
    edges = {v: int(graph.edges[v[1] - j, v[0] - i]) for v in viewpoints}
    assert edges == reference.all_edges
    assert not graph.edges[~graph.exists].any()
    counts = {v: int(mapper._utility.counts[v[1] - j, v[0] - i]) for v in viewpoints}
    assert counts == reference.all_counts
    assert not mapper._utility.counts[~graph.exists].any()

    expected = reference.observation
    assert mapper.stuck == (expected is None)
    if expected is None:
        return
    observation = mapper.observe()
    for name in ("offsets", "utility", "visited", "beacon", "edges", "target_offset", "target_links"):
        got, want = getattr(observation, name), getattr(expected, name)
        assert got.dtype == want.dtype, name
        np.testing.assert_array_equal(got, want, err_msg=name)
    for name in ("robot", "has_target", "target_known"):
        assert getattr(observation, name) == getattr(expected, name), name
    distances = mapper.distances(observation.robot)[: observation.viewpoints]
    np.testing.assert_allclose(distances, reference.distances(observation.robot))


def random_scan(rng: np.random.Generator, free: np.ndarray, resolution: float, pose: Pose, origin) -> Scan:
    """A true scan, sometimes with noise, junk or too long a range: the mapping must follow any of them."""
    scan = scan_of(free, resolution, origin, pose, range_max=float(rng.choice([4.0, 8.0, 12.0])), beams=90)
    kind = rng.integers(0, 4)
    ranges = scan.ranges.copy()
    if kind == 1:
        ranges += rng.normal(0.0, 0.3, len(ranges)).astype(np.float32)
    elif kind == 2:
        some = rng.integers(0, len(ranges), 20)
        ranges[some] = rng.choice([np.nan, np.inf, 0.0, -1.0, 0.05, 3.0], 20)
    return Scan(ranges, scan.angle_min, scan.angle_increment, scan.range_max, float(rng.choice([0.0, 0.1])))


@SETTINGS
@given(
    seed=st.integers(0, 2**32 - 1),
    resolution=st.sampled_from([0.2, 0.25, 0.5]),
    spacing=st.sampled_from([1.0, 1.3, 2.0, 2.5]),
    with_bounds=st.booleans(),
    with_target=st.booleans(),
    aligned=st.booleans(),
    origin=st.sampled_from([(0.0, 0.0), (-7.5, -3.25), (100.0, -0.5)]),
    steps=st.integers(1, 6),
)
def test_equals_the_reference_after_every_step(
    seed, resolution, spacing, with_bounds, with_target, aligned, origin, steps
):
    rng = np.random.default_rng(seed)
    rows, columns = int(rng.integers(12, 36)), int(rng.integers(12, 36))
    free = random_world(rng, rows, columns)
    width, height = columns * resolution, rows * resolution
    lattice = origin if aligned else tuple(float(o + rng.uniform(0, spacing)) for o in origin)
    bounds = (*origin, origin[0] + width, origin[1] + height) if with_bounds else None
    target = (
        (float(origin[0] + rng.uniform(0, width)), float(origin[1] + rng.uniform(0, height))) if with_target else None
    )
    config = MappingConfig(
        resolution=resolution,
        sensor_range=6.0,
        viewpoint_spacing=spacing,
        utility_range=float(rng.choice([2.5, 6.0])),
        beacon_range=float(rng.choice([3.0, 20.0])),
        min_utility=int(rng.choice([1, 2, 3, 12])),
        least_utility=int(rng.integers(1, 4)),
    )
    mapper = Mapper(config, lattice_origin=lattice, bounds=bounds, target=target)
    reference = ReferenceMapper(config, lattice, origin if with_bounds else lattice, target)
    for _ in range(steps):
        for _ in range(rng.integers(0, 3)):
            row, column = rng.choice(np.argwhere(free))
            exact = rng.random() < 0.5
            pose = Pose(
                float(origin[0] + (column + (0.0 if exact else rng.random())) * resolution),
                float(origin[1] + (row + (0.0 if exact else rng.random())) * resolution),
                float(rng.choice([0.0, np.pi / 2, rng.uniform(-4, 4)])),
            )
            scan = random_scan(rng, free, resolution, pose, origin)
            assert mapper.integrate(scan, pose) == reference.integrate(scan, pose)
        pose = (
            Pose(float(origin[0] + rng.uniform(-1, width)), float(origin[1] + rng.uniform(-1, height)))
            if rng.random() < 0.3
            else pose_in(mapper, rng, origin)
        )
        mapper.update(pose)
        reference.update(pose)
        assert_same(mapper, reference)


def pose_in(mapper: Mapper, rng: np.random.Generator, fallback: tuple[float, float]) -> Pose:
    """A pose in a free cell of the belief, sometimes exactly on a viewpoint."""
    if not mapper.stuck and rng.random() < 0.5:
        return Pose(*rng.choice(mapper.viewpoints).tolist())
    cells = np.argwhere(mapper.belief.cells == 0)
    if not len(cells):
        return Pose(*fallback)
    row, column = rng.choice(cells) + rng.random(2)
    x, y = mapper.belief.origin
    return Pose(float(x + column * mapper.belief.resolution), float(y + row * mapper.belief.resolution))


@settings(SETTINGS, max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), resolution=st.sampled_from([0.25, 0.5]), steps=st.integers(1, 8))
def test_follows_any_change_of_any_cell(seed, resolution, steps):
    """Cells may become free, occupied or unknown again, as when the robot's own SLAM closes a loop."""
    rng = np.random.default_rng(seed)
    config = MappingConfig(resolution=resolution, sensor_range=5.0, viewpoint_spacing=4 * resolution, beacon_range=4.0)
    mapper = Mapper(config, lattice_origin=(0.0, 0.0), target=(3.0, 3.0))
    reference = ReferenceMapper(config, (0.0, 0.0), (0.0, 0.0), (3.0, 3.0))
    for step in range(steps):
        shape = (20, 20) if step == 0 else tuple(rng.integers(1, 12, 2))
        row, column = (0, 0) if step == 0 else rng.integers(-6, 20, 2).tolist()
        values = np.where(rng.random(shape) < 0.04, 100, rng.choice([0, 0, 0, -1, 100])).astype(np.int8)
        mapper.belief.assign(values, (column * resolution, row * resolution))
        reference.assign(values, row, column)
        pose = pose_in(mapper, rng, (0.0, 0.0))
        mapper.update(pose)
        reference.update(pose)
        assert_same(mapper, reference)


def test_every_single_cell_may_come_and_go():
    """Each cell in turn becomes a wall and free again; what came of it equals a mapper that saw nothing else."""
    config = MappingConfig(resolution=0.5, sensor_range=4.0, viewpoint_spacing=2.0, beacon_range=4.0)
    cells = np.zeros((18, 18), dtype=np.int8)
    cells[9:, 12:] = -1
    mapper = Mapper(config, lattice_origin=(0.0, 0.0))
    mapper.belief.assign(cells, (0.0, 0.0))
    mapper.update(Pose(4.0, 4.0))
    for row, column in np.ndindex(cells.shape):
        for value in (100, -1 - cells[row, column], cells[row, column]):
            changed = cells.copy()
            changed[row, column] = value
            mapper.belief.assign(np.array([[value]], dtype=np.int8), (0.5 * column, 0.5 * row))
            mapper.update(Pose(4.0, 4.0))
            fresh = Mapper(config, lattice_origin=(0.0, 0.0))
            fresh.belief.assign(changed, (0.0, 0.0))
            fresh.update(Pose(4.0, 4.0))
            np.testing.assert_array_equal(mapper.frontiers, fresh.frontiers)
            np.testing.assert_array_equal(mapper._graph.exists, fresh._graph.exists)
            np.testing.assert_array_equal(mapper._graph.edges, fresh._graph.edges)
            np.testing.assert_array_equal(mapper._utility.counts, fresh._utility.counts)
            assert mapper.explored_area == fresh.explored_area


@pytest.mark.slow
def test_equals_the_reference_on_a_long_walk():
    rng = np.random.default_rng(7)
    free = random_world(rng, 60, 70)
    config = MappingConfig(resolution=0.5, sensor_range=8.0, viewpoint_spacing=2.0, beacon_range=8.0)
    mapper = Mapper(config, lattice_origin=(1.0, 1.0), target=(30.0, 25.0))
    reference = ReferenceMapper(config, (1.0, 1.0), (1.0, 1.0), (30.0, 25.0))
    row, column = np.argwhere(free)[len(np.argwhere(free)) // 2]
    pose = Pose((column + 0.5) * 0.5, (row + 0.5) * 0.5)
    for _ in range(25):
        scan = scan_of(free, 0.5, (0.0, 0.0), pose, beams=360)
        mapper.integrate(scan, pose)
        reference.integrate(scan, pose)
        mapper.update(pose)
        reference.update(pose)
        assert_same(mapper, reference)
        waypoints = mapper.observe().waypoint_nodes()
        pose = Pose(*mapper.position(int(rng.choice(waypoints)))) if len(waypoints) else pose
