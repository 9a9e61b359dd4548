"""The graph of wider viewpoints: a valid observation of the same place, in which nothing is lost."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.errors import MappingError
from common.geometry import Pose
from common.mapping.coarse_graph import coarse_graph
from common.mapping.mapper import Mapper
from common.messages.validation import check_observations
from common.observation import NEIGHBOUR_OFFSETS, ObservationBatch
from tests.common.mapping.worlds import see, small_config


def walls(*lines: tuple[slice | int, slice | int], size: int = 48) -> np.ndarray:
    free = np.ones((size, size), dtype=np.bool_)
    free[[0, -1], :] = False
    free[:, [0, -1]] = False
    for line in lines:
        free[line] = False
    return free


def explored(free: np.ndarray, *places: tuple[float, float], target=None, **changes) -> Mapper:
    mapper = Mapper(small_config(viewpoint_spacing=1.0, **changes), lattice_origin=(1.0, 1.0), target=target)
    for x, y in places:
        see(mapper, free, Pose(x, y))
    return mapper


def component(edges: np.ndarray, offsets: np.ndarray, start: int) -> set[int]:
    place = {(int(x), int(y)): k for k, (x, y) in enumerate(offsets)}
    found, stack = {start}, [start]
    while stack:
        node = stack.pop()
        for bit in np.flatnonzero(edges[node] >> np.arange(20, dtype=np.uint32) & 1):
            other = place[tuple((offsets[node] + NEIGHBOUR_OFFSETS[bit]).tolist())]
            if other not in found:
                found.add(other)
                stack.append(other)
    return found


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 5), st.booleans())
def test_it_is_a_valid_observation_of_all_that_can_be_reached(seed, factor, with_target):
    random = np.random.default_rng(seed)
    free = walls()
    for _ in range(6):
        row, column, length = random.integers(1, 46), random.integers(1, 46), random.integers(4, 30)
        if random.random() < 0.5:
            free[row, column : column + length] = False
        else:
            free[row : row + length, column] = False
    cells = np.argwhere(free)
    places = [tuple((cells[k][::-1] + 0.5) * 0.5) for k in random.integers(len(cells), size=3)]
    mapper = explored(free, *places, target=(20.3, 4.1) if with_target else None)
    if mapper.stuck:
        return
    fine, graph = mapper.observe(), coarse_graph(mapper, factor)
    coarse = graph.observation
    check_observations(ObservationBatch.stack([coarse]), "coarse")
    assert graph.nodes[coarse.robot] == fine.robot
    assert coarse.offsets[coarse.robot].tolist() == [0, 0]
    assert len(component(coarse.edges, coarse.offsets, coarse.robot)) == coarse.viewpoints
    # Each stands for the square in which it lies, and every viewpoint lies in the square of one.
    middle = factor * coarse.offsets.astype(int)
    for node, centre in zip(graph.nodes[: coarse.viewpoints], middle, strict=True):
        assert np.abs(fine.offsets[node] - centre).max() <= factor / 2
    squares = {tuple(s) for s in coarse.offsets.tolist()}
    assert {tuple(s) for s in ((fine.offsets.astype(int) + factor // 2) // factor).tolist()} == squares
    # Nothing that is worth going to is lost.
    assert bool(coarse.utility.any()) == bool(fine.utility.any())
    assert np.count_nonzero(coarse.beacon) <= np.count_nonzero(fine.beacon)
    assert bool(coarse.beacon.any()) == bool(fine.beacon.any())
    assert coarse.target_known == fine.target_known
    assert (len(graph.nodes) == coarse.viewpoints + 1) == with_target
    if with_target:
        assert graph.nodes[-1] == fine.viewpoints
        np.testing.assert_allclose(coarse.target_offset * factor, fine.target_offset, rtol=1e-6)


def test_the_factor_one_is_the_graph_of_the_mapper():
    mapper = explored(walls(), (5.0, 5.0))
    graph = coarse_graph(mapper, 1)
    np.testing.assert_array_equal(graph.observation.offsets, mapper.observe().offsets)
    np.testing.assert_array_equal(graph.nodes, np.arange(mapper.observe().nodes))


def test_in_the_open_it_is_the_lattice_of_wider_viewpoints():
    free = walls()
    mapper = explored(free, (9.0, 9.0), sensor_range=40.0)
    wide = Mapper(small_config(viewpoint_spacing=4.0, sensor_range=40.0), lattice_origin=(1.0, 1.0))
    see(wide, free, Pose(9.0, 9.0))
    coarse = coarse_graph(mapper, 4).observation
    inner = np.abs(wide.observe().offsets).max(axis=1) <= 1
    kept = np.abs(coarse.offsets).max(axis=1) <= 1
    np.testing.assert_array_equal(coarse.offsets[kept], wide.observe().offsets[inner])
    robot = coarse.robot
    assert coarse.edges[robot] == wide.observe().edges[wide.robot]


def test_a_room_behind_a_door_that_no_wide_viewpoint_meets_stays_on_the_graph():
    # A wall along x = 12 m with one door, 1 m wide; the robot has looked through it and knows both rooms.
    free = walls((slice(0, 48), 24))
    free[23:26, 24] = True
    mapper = explored(free, (4.0, 6.0), (11.0, 12.0), (18.0, 18.0), (4.0, 6.0), sensor_range=30.0)
    graph = coarse_graph(mapper, 4)
    positions = np.array([mapper.position(int(node)) for node in graph.nodes])
    assert (positions[:, 0] > 13.0).sum() > 5
    everywhere = component(graph.observation.edges, graph.observation.offsets, graph.observation.robot)
    assert len(everywhere) == len(graph.nodes)


def test_a_stuck_robot_has_no_graph():
    mapper = Mapper(small_config(viewpoint_spacing=1.0), lattice_origin=(1.0, 1.0))
    mapper.update(Pose(5.0, 5.0))
    with pytest.raises(MappingError, match="no viewpoint within"):
        coarse_graph(mapper, 2)
