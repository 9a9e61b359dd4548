"""The mapper against the reference: equal after every step, whatever the world, the walk and the scans."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from common.config import MappingConfig
from common.geometry import Pose, Scan
from common.mapping.mapper import Mapper
from common.observations.observation import STEP_UNITS
from tests.common.mapping.reference import UNIT, ReferenceMapper, flood
from tests.common.mapping.worlds import random_world, scan_of
from tests.effort import examples

SETTINGS = settings(
    max_examples=examples(25), deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)


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
    # All viewpoints and what they observe, reachable or not.
    pieces = mapper._graph.pieces
    existing = np.flatnonzero(pieces["exists"])
    shift = np.array([first_column - 1, first_row - 1]) * UNIT
    places = np.stack([pieces["x"], pieces["y"]], axis=1) + shift
    counts = {tuple(places[k].tolist()): int(mapper._utility.counts[k]) for k in existing}
    assert counts == {piece.place: reference.counts[piece] for piece in reference.viewpoints}

    assert mapper.stuck == (reference.robot is None)
    if reference.robot is None:
        return
    nodes = reference.nodes
    n = len(nodes)
    number = {piece: k for k, piece in enumerate(nodes)}
    assert [tuple(p) for p in places[mapper._order].tolist()] == [piece.place for piece in nodes]
    observation = mapper.observe()
    assert observation.robot == mapper.robot == number[reference.robot]
    assert observation.utility.tolist() == reference.utility
    assert observation.visited.tolist() == [piece.visited and not piece.lookout for piece in nodes]
    assert observation.beacon.tolist() == reference.beacon
    assert observation.has_target == (reference.target is not None)
    assert observation.target_known == reference.target_known
    assert observation.target_links.tolist() == reference.links
    spacing, resolution = mapper._config.viewpoint_spacing, mapper._config.resolution
    positions = np.array([piece.place for piece in nodes]) / UNIT * resolution + reference.anchor
    np.testing.assert_allclose(mapper.viewpoints, positions, atol=1e-4 * resolution)
    robot = positions[mapper.robot]
    # Offsets are rounded on the lattice, each at its own end.
    np.testing.assert_allclose(observation.offsets / STEP_UNITS, (positions - robot) / spacing, atol=1.01 / STEP_UNITS)
    if reference.target is not None:
        np.testing.assert_allclose(
            observation.target_offset, (reference.target - robot) / spacing, rtol=1e-4, atol=1e-4
        )

    edges = mapper.adjacency
    starts = np.repeat(np.arange(n), np.diff(edges.pointer))
    pairs = list(zip(starts.tolist(), edges.neighbours.tolist(), strict=True))
    for kind, wanted in ((False, reference.straight), (True, reference.bent)):
        expected = {(number[a], number[b]) for a, b in wanted if a in number and b in number}
        got = [pair for pair, bent in zip(pairs, edges.bent, strict=True) if bent == kind]
        assert len(got) == len(set(got))
        assert set(got) == expected
    straight = np.hypot(*(positions[edges.neighbours] - positions[starts]).T)
    np.testing.assert_allclose(edges.lengths[~edges.bent], straight[~edges.bent], atol=1e-4 * resolution)
    assert (edges.lengths[edges.bent] >= straight[edges.bent] - 1e-4 * resolution).all()
    # The observation lists the same edges.
    lower = np.repeat(np.arange(n), observation.degree)
    listed = list(zip(lower.tolist(), observation.neighbours.tolist(), strict=True))
    assert listed == [pair for pair in pairs if pair[0] < pair[1]]
    np.testing.assert_array_equal(observation.bent, np.flatnonzero(edges.bent[starts < edges.neighbours]))
    np.testing.assert_allclose(
        observation.bent_length * spacing, edges.lengths[edges.bent & (starts < edges.neighbours)], rtol=1e-6
    )
    np.testing.assert_allclose(
        mapper.distances(mapper.robot)[:n], relax(n, pairs, edges.lengths.tolist(), mapper.robot)
    )
    assert_reaches_what_can_be_reached(mapper, reference)


def assert_reaches_what_can_be_reached(mapper: Mapper, reference: ReferenceMapper) -> None:
    """The nodes are the pieces that the inflated grid connects with the robot's, but for those that wait."""
    assert reference.robot is not None
    connected = flood(min(reference.robot.cells), reference.passable)
    pieces = [piece for piece in reference.pieces if piece.cells <= connected]
    if reference.nothing_left:
        assert reference.nodes == pieces
    else:
        assert set(reference.nodes) <= set(pieces)


def relax(n: int, pairs: list[tuple[int, int]], lengths: list[float], source: int) -> list[float]:
    """Bellman and Ford's way: relax all edges until nothing changes."""
    best = [inf] * n
    best[source] = 0.0
    changed = True
    while changed:
        changed = False
        for (a, b), length in zip(pairs, lengths, strict=True):
            if best[a] + length < best[b] - 1e-12:
                best[b] = best[a] + length
                changed = True
    return best


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
    resolution=st.sampled_from([0.1, 0.2, 0.25, 0.5]),
    spacing=st.sampled_from([1.0, 1.3, 2.0, 2.5]),
    with_bounds=st.booleans(),
    with_target=st.booleans(),
    aligned=st.booleans(),
    origin=st.sampled_from([(0.0, 0.0), (-7.5, -3.25), (100.0, -0.5)]),
    radius=st.sampled_from([0.0, 0.1, 0.25, 0.4]),
    steps=st.integers(1, 6),
)
# A piece whose viewpoint was at a lookout waits for its lattice point again.
@example(
    seed=2408460813,
    resolution=0.2,
    spacing=2.5,
    radius=0.1,
    with_bounds=True,
    with_target=True,
    aligned=True,
    origin=(0.0, 0.0),
    steps=7,
)
# A viewpoint at a lookout when the robot loses clear space.
@example(
    seed=1773912972,
    resolution=0.5,
    spacing=2.5,
    radius=0.1,
    with_bounds=True,
    with_target=False,
    aligned=False,
    origin=(100.0, -0.5),
    steps=8,
)
def test_equals_the_reference_after_every_step(
    seed, resolution, spacing, radius, with_bounds, with_target, aligned, origin, steps
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
        robot_radius=radius,
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
            # Poses jump: they are no track along which the robot could go back.
            assert mapper.belief.integrate(scan, pose) == reference.integrate(scan, pose)
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


@settings(SETTINGS, max_examples=examples(15))
@given(
    seed=st.integers(0, 2**32 - 1),
    resolution=st.sampled_from([0.25, 0.5]),
    radius=st.sampled_from([0.0, 0.1, 0.25, 0.4]),
    steps=st.integers(1, 8),
)
def test_follows_any_change_of_any_cell(seed, resolution, radius, steps):
    """Cells may become free, occupied or unknown again, as when the robot's own SLAM closes a loop."""
    rng = np.random.default_rng(seed)
    config = MappingConfig(
        resolution=resolution,
        sensor_range=5.0,
        viewpoint_spacing=4 * resolution,
        robot_radius=radius,
        beacon_range=4.0,
    )
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
        mapper.belief.integrate(scan, pose)
        reference.integrate(scan, pose)
        mapper.update(pose)
        reference.update(pose)
        assert_same(mapper, reference)
        waypoints = mapper.observe().waypoint_nodes()
        pose = Pose(*mapper.position(int(rng.choice(waypoints)))) if len(waypoints) else pose
