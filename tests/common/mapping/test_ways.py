"""Ways along edges, to the robot's viewpoint and to the target: a disc of the robot's radius can follow them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from actors.maps.connectivity import reachable
from common.config import MappingConfig
from common.errors import MappingError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from tests.common.mapping.worlds import random_world, see_all, small_config
from tests.effort import examples
from tests.plans import clear_cells

Position = tuple[float, float]
SETTINGS = settings(max_examples=examples(25), deadline=None, derandomize=True)


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


def mapper_on(free: np.ndarray, config: MappingConfig, rng: np.random.Generator) -> Mapper:
    """A mapper whose cells are those of a world, and whose lattice lies anywhere."""
    rows, columns = free.shape
    return Mapper(
        config,
        lattice_origin=tuple(rng.uniform(0.0, config.viewpoint_spacing, 2).tolist()),
        bounds=(0.0, 0.0, columns * config.resolution, rows * config.resolution),
    )


def space_along(free: np.ndarray, resolution: float, a: Position, b: Position, most: float) -> float:
    """Distance of a segment from what is not free, metres, at most so much: at points a twentieth of a cell apart."""
    count = int(np.hypot(b[0] - a[0], b[1] - a[1]) / resolution * 20) + 2
    points = np.linspace(a, b, count) / resolution
    padded = np.pad(free, 1)
    columns, rows = (points - most / resolution).min(axis=0), (points + most / resolution).max(axis=0)
    left, bottom = (max(int(np.floor(v)) + 1, 0) for v in columns)
    right, top = (int(np.floor(v)) + 2 for v in rows)
    blocked = np.argwhere(~padded[bottom : top + 1, left : right + 1]) + np.array([bottom - 1, left - 1])
    if not len(blocked):
        return most
    low = blocked[:, ::-1].astype(float)
    gaps = np.maximum(np.maximum(low - points[:, None], points[:, None] - low - 1.0), 0.0)
    return min(float(np.hypot(gaps[..., 0], gaps[..., 1]).min()) * resolution, most)


def legs_of(start: Position, way: list[Position]) -> list[tuple[Position, Position]]:
    return list(zip([start, *way[:-1]], way, strict=True))


@SETTINGS
@given(
    seed=st.integers(0, 2**32 - 1),
    resolution=st.sampled_from([0.05, 0.1, 0.2, 0.25]),
    spacing=st.sampled_from([1.0, 1.7, 3.0]),
    radius=st.sampled_from([0.0, 0.1, 0.25, 0.5]),
)
def test_every_edge_can_be_driven_both_ways(seed, resolution, spacing, radius):
    rng = np.random.default_rng(seed)
    free = random_world(rng, 40, 50)
    config = MappingConfig(resolution=resolution, sensor_range=5.0, viewpoint_spacing=spacing, robot_radius=radius)
    mapper = mapper_on(free, config, rng)
    clear = np.argwhere(clear_cells(free, radius, resolution))
    if not len(clear):
        return
    row, column = rng.choice(clear)
    see_all(mapper, free, Pose((column + 0.5) * resolution, (row + 0.5) * resolution))
    adjacency = mapper.adjacency
    for a in range(len(mapper.viewpoints)):
        for k in range(adjacency.pointer[a], adjacency.pointer[a + 1]):
            b = int(adjacency.neighbours[k])
            if b < a:
                continue
            way, back = mapper.way(a, b), mapper.way(b, a)
            assert (way[-1], back[-1]) == (mapper.position(b), mapper.position(a))
            assert way[:-1] == back[:-1][::-1]
            assert len(way) == 1 or adjacency.bent[k]
            legs = legs_of(mapper.position(a), way)
            length = sum(float(np.hypot(q[0] - p[0], q[1] - p[1])) for p, q in legs)
            assert length == pytest.approx(adjacency.lengths[k], abs=1e-3 * resolution)
            for p, q in legs:
                assert mapper.segment_free(p, q) and mapper.segment_free(q, p)
                if adjacency.bent[k] or rng.random() < 0.1:
                    assert space_along(free, resolution, p, q, radius + resolution) >= radius - 1e-3 * resolution


def space_at_middles(free: np.ndarray) -> np.ndarray:
    """Distance of the middle of each cell from what is not free, cells; 0 where that is the cell itself."""
    blocked = np.argwhere(~np.pad(free, 1)) - 1
    space = np.zeros(free.shape)
    for row, column in np.argwhere(free):
        gaps = np.maximum(np.abs(blocked - (row, column)) - 0.5, 0.0)
        space[row, column] = np.hypot(*gaps.T).min()
    return space


@SETTINGS
@given(
    seed=st.integers(0, 2**32 - 1),
    resolution=st.sampled_from([0.05, 0.1, 0.2, 0.25]),
    spacing=st.sampled_from([1.0, 1.7, 3.0]),
    radius=st.sampled_from([0.0, 0.1, 0.25, 0.5]),
)
def test_the_way_home_comes_no_nearer_to_anything_than_the_robot_is(seed, resolution, spacing, radius):
    """From beside clear space, too, where the robot is nearer to a wall than it should be, if there is such a way."""
    rng = np.random.default_rng(seed)
    free = random_world(rng, 40, 50)
    config = MappingConfig(resolution=resolution, sensor_range=5.0, viewpoint_spacing=spacing, robot_radius=radius)
    mapper = mapper_on(free, config, rng)
    see_all(mapper, free, Pose(1.0, 1.0))
    clear, space = clear_cells(free, radius, resolution), space_at_middles(free) * resolution
    for row, column in rng.permutation(np.argwhere(free))[:60]:
        x, y = (float(number + part) * resolution for number, part in zip((column, row), rng.random(2), strict=True))
        mapper.update(Pose(x, y))
        gap = space_along(free, resolution, (x, y), (x, y), radius)
        keep = gap - 1e-3 * resolution
        # Cells around where the robot may be without coming nearer, connected with its own.
        rows, columns = np.indices(free.shape)
        around = np.maximum(np.abs(rows - row), np.abs(columns - column)) <= (radius + 0.5) / resolution
        open_cells = around & free & (space >= gap)
        middle = ((column + 0.5) * resolution, (row + 0.5) * resolution)
        own = bool(open_cells[row, column]) and space_along(free, resolution, (x, y), middle, radius) >= gap
        must_keep = bool(clear[row, column]) or (own and bool((reachable(open_cells, (row, column)) & clear).any()))
        if mapper.stuck:
            assert not must_keep
            continue
        way = mapper.way_home()
        assert way[-1] == mapper.position(mapper.robot)
        if must_keep:
            assert all(space_along(free, resolution, *leg, radius) >= keep for leg in legs_of((x, y), way))


def test_the_way_home_from_the_border_of_two_squares_leads_through_one_of_them() -> None:
    """A robot there may stand in the piece of the other square than the cell above and right of it."""
    rng = np.random.default_rng(1)
    config = MappingConfig(resolution=0.25, sensor_range=5.0, viewpoint_spacing=2.0, robot_radius=0.25)
    bent = 0
    for _ in range(6):
        free = random_world(rng, 40, 50)
        mapper = Mapper(config, lattice_origin=(1.0, 1.0), bounds=(0.0, 0.0, 12.5, 10.0))
        see_all(mapper, free, Pose(1.0, 1.0))
        clear = clear_cells(free, 0.25, 0.25)
        for row, column in np.ndindex(4, 6):
            # Corners of cells, where four squares meet; all of the cells around must be clear.
            y, x = 2.0 * (row + 1), 2.0 * (column + 1)
            cells = np.s_[int(4 * y) - 1 : int(4 * y) + 1, int(4 * x) - 1 : int(4 * x) + 1]
            if not clear[cells].all():
                continue
            mapper.update(Pose(x, y))
            way = mapper.way_home()
            bent += len(way) > 1
            assert all(space_along(free, 0.25, *leg, 0.25) >= 0.25 - 1e-3 for leg in legs_of((x, y), way))
    assert bent


@SETTINGS
@given(
    seed=st.integers(0, 2**32 - 1),
    resolution=st.sampled_from([0.05, 0.1, 0.15, 0.25]),
    spacing=st.sampled_from([1.0, 1.5, 2.0, 4.0, 6.0]),
    radius=st.sampled_from([0.0, 0.1, 0.2, 0.25, 0.35, 0.5]),
    excess=st.integers(-3, 4),
)
def test_the_graph_leads_through_a_door_just_when_the_robot_fits_through(seed, resolution, spacing, radius, excess):
    """Two rooms, and a door whose width is twice the radius and a few cells."""
    rng = np.random.default_rng(seed)
    config = MappingConfig(resolution=resolution, sensor_range=5.0, viewpoint_spacing=spacing, robot_radius=radius)
    rows, columns, thick = (int(v / resolution) for v in (3.0 + rng.uniform(0, 2), 6.0 + rng.uniform(0, 4), 0.3))
    free = np.zeros((rows, columns), dtype=np.bool_)
    free[1:-1, 1:-1] = True
    wall = columns // 2
    free[:, wall : wall + thick] = False
    width = max(round(2 * radius / resolution) + excess, 1)
    bottom = int(rng.integers(1, rows - 1 - width))
    free[bottom : bottom + width, wall : wall + thick] = True
    free = free.T if rng.random() < 0.5 else free
    mapper = mapper_on(free, config, rng)
    clear = clear_cells(free, radius, resolution)
    start = tuple(rng.choice(np.argwhere(clear)).tolist())
    see_all(mapper, free, Pose((start[1] + 0.5) * resolution, (start[0] + 0.5) * resolution))
    cells = np.argwhere(clear)
    nodes = mapper.nodes_at((cells[:, ::-1] + 0.5) * resolution)
    reached = reachable(clear, start)[cells[:, 0], cells[:, 1]]
    np.testing.assert_array_equal(nodes >= 0, reached)
    # Every viewpoint stands for some of them.
    assert set(nodes[reached].tolist()) == set(range(len(mapper.viewpoints)))
    assert np.isfinite(mapper.distances(mapper.robot)).all()
