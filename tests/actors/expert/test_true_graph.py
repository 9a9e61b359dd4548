from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from actors.expert.true_graph import TrueGraph
from actors.maps.clear_space import known_cells
from actors.maps.grid_map import GridMap
from actors.tasks.coverage import Coverage
from common.config import MappingConfig
from common.errors import MapError
from tests.actors.worlds import draw

DOOR = draw(
    "###########",
    "#S...#....#",
    "#....#....#",
    "#.........#",
    "#....#....#",
    "###########",
    resolution=0.25,
    lattice=(2.5, 3.5),
)


def mapping(spacing, radius=0.0, resolution=0.5):
    return MappingConfig(resolution=resolution, viewpoint_spacing=spacing, robot_radius=radius)


def edges(graph):
    return {
        (a, int(b)): float(length)
        for a in range(len(graph))
        for b, length in zip(
            graph.neighbours[graph.pointer[a] : graph.pointer[a + 1]],
            graph.lengths[graph.pointer[a] : graph.pointer[a + 1]],
            strict=True,
        )
    }


def test_a_corridor_has_known_distances():
    world = draw("##############", "#S...........#", "##############", lattice=(0.5, 1.5))
    graph = TrueGraph.build(world, mapping(2.0))
    # Lattice points at x = 0.5 + 2 i: those from 2.5 to 12.5 are free; half a metre before the first is its piece.
    inside = [node for node in range(len(graph)) if graph.positions[node, 0] % 2.0 == 0.5]
    assert graph.positions[inside, 0].tolist() == [2.5, 4.5, 6.5, 8.5, 10.5, 12.5]
    distances = graph.distances()
    assert distances[inside[0], inside] == pytest.approx(np.arange(6) * 2.0)
    assert np.array_equal(distances, distances.T)
    # No edge of two spacings: the robot stops between as well and sees more.
    assert not {(a, b) for a, b in edges(graph) if {a, b} <= set(inside) and abs(a - b) > 1}


def test_edges_are_symmetric_and_walls_cut_them():
    world = draw("#########", "#S..#...#", "#...#...#", "#.......#", "#########")
    graph = TrueGraph.build(world, mapping(1.0))
    found = edges(graph)
    assert {(b, a): length for (a, b), length in found.items()} == found
    for (a, b), length in found.items():
        assert length == pytest.approx(np.hypot(*(graph.positions[a] - graph.positions[b])))
    (left, right), _ = graph.match(np.array([[3.5, 3.5], [5.5, 3.5]]))
    # Round the wall's end at (4.5, 1.5): two edges of sqrt(5) would touch the wall's corner.
    assert graph.distances()[left, right] == pytest.approx(2 * 2 + 2)


def test_a_way_round_a_corner_counts_with_its_length():
    graph = TrueGraph.build(DOOR, mapping(4.0, resolution=0.25))
    for (a, b), length in edges(graph).items():
        corners = np.array([graph.positions[a], *graph.mapper.way(a, b)])
        assert length == pytest.approx(np.hypot(*np.diff(corners, axis=0).T).sum(), abs=1e-4)
        assert length >= np.hypot(*(graph.positions[a] - graph.positions[b])) - 1e-4
        for one, other in zip(corners[:-1].tolist(), corners[1:].tolist(), strict=True):
            assert graph.mapper.segment_free(tuple(one), tuple(other))


def test_a_door_parts_the_graph_of_a_robot_that_is_too_wide():
    beyond = np.array([[8.5, 2.5]])
    assert TrueGraph.build(DOOR, mapping(4.0, 0.35, resolution=0.25)).match(beyond)[0] >= 0
    assert TrueGraph.build(DOOR, mapping(4.0, 0.6, resolution=0.25)).match(beyond)[0] == -1
    with pytest.raises(MapError, match="robot_radius"):
        TrueGraph.build(replace(DOOR, start=(1.1, 4.9)), mapping(4.0, 2.5))


@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    radius=st.sampled_from([0.0, 0.2, 0.3, 0.55]),
    spacing=st.sampled_from([1.0, 1.75, 4.0]),
)
def test_the_graph_stands_for_every_cell_that_counts_as_reachable(seed, radius, spacing):
    rng = np.random.default_rng(seed)
    free = np.kron(rng.random((8, 10)) < 0.7, np.ones((5, 5), dtype=np.bool_))
    free[rng.integers(40, size=12), rng.integers(50, size=12)] = False
    places = np.argwhere(free)
    row, column = places[rng.integers(len(places))]
    start = ((column + 0.5) * 0.25, (row + 0.5) * 0.25)
    world = GridMap("random", free, 0.25, (0.0, 0.0), start, None, None, (1.0, 1.0))
    try:
        counted = Coverage(world, radius).unseen_cells
    except MapError:
        with pytest.raises(MapError):
            TrueGraph.build(world, mapping(spacing, radius, resolution=0.25))
        return
    graph = TrueGraph.build(world, mapping(spacing, radius, resolution=0.25))
    centres = np.stack([np.tile(np.arange(50) + 0.5, 40), np.repeat(np.arange(40) + 0.5, 50)], axis=1) * 0.25
    nodes, places = graph.match(centres)
    assert np.array_equal(np.flatnonzero(nodes >= 0), counted)
    assert np.array_equal(np.unique(nodes[nodes >= 0]), np.arange(len(graph)))
    assert np.isfinite(graph.distances()).all()
    assert np.array_equal(places[counted], graph.positions[nodes[counted]])
    assert np.array_equal(graph.match(graph.positions)[0], np.arange(len(graph)))


def test_ways_to_the_target_end_there():
    world = draw(
        "###########",
        "#S...#....#",
        "#....#..T.#",
        "#.........#",
        "#....#....#",
        "###########",
        resolution=0.25,
        lattice=(2.5, 3.5),
    )
    graph = TrueGraph.build(world, mapping(4.0, 0.25))
    to_target = graph.distances_to_target()
    links, lengths = graph.target_links()
    assert len(links) > 0
    distances = graph.distances()
    expected = (distances[:, links] + lengths).min(axis=1)
    assert to_target == pytest.approx(expected, abs=1e-3)
    sealed = replace(world, free=world.free & (np.arange(world.free.shape[1]) != 22))
    assert np.isinf(TrueGraph.build(sealed, mapping(4.0, 0.25)).distances_to_target()).all()


@pytest.mark.parametrize("resolution", [0.1, 0.2, 0.25, 0.3, 0.5, 0.7, 1.0, 4.0])
def test_cells_of_another_side_are_free_where_all_of_them_is(resolution):
    world = replace(DOOR, free=DOOR.free & (np.random.default_rng(0).random(DOOR.free.shape) > 0.05))
    cells = known_cells(world, resolution)
    width, height = world.size
    assert cells.shape == (int(np.ceil(height / resolution - 1e-6)), int(np.ceil(width / resolution - 1e-6)))
    for row, column in np.ndindex(cells.shape):
        # Places well inside the cell, and of the world's cells that it reaches over all.
        across = (np.arange(1, 100) / 100 + column) * resolution
        up = (np.arange(1, 100) / 100 + row) * resolution
        inside = (across < width).all() and (up < height).all()
        columns, rows = (across / 0.25).astype(int), (up / 0.25).astype(int)
        free = inside and world.free[np.ix_(rows, columns)].all()
        assert (cells[row, column] == 0) == free
