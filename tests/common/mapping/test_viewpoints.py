"""Where viewpoints are, in worlds small enough to check by eye."""

from __future__ import annotations

import numpy as np

from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.sight import NOTHING_LOST
from tests.common.mapping.worlds import small_config


def test_a_viewpoint_beside_its_lattice_point_keeps_away_from_a_wall_in_the_next_square():
    # Squares of 8 cells; the lower right quarter of the left one is free, and so is what lies right of it.
    mapper = Mapper(small_config(viewpoint_spacing=4.0, resolution=0.25), lattice_origin=(2.0, 2.0))
    cells = np.full((16, 32), 100, dtype=np.int8)
    cells[1:7, 14:24] = 0
    mapper.belief.assign(cells, (0.0, 0.0))
    mapper.update(Pose(3.9, 1.0))
    assert mapper.position(mapper.robot) == (3.875, 1.375)
    cells[1:7, 16] = 100
    mapper.belief.assign(cells[1:7, 16:17], (4.0, 0.25))
    mapper.update(Pose(3.9, 1.0))
    assert mapper.position(mapper.robot) == (3.625, 1.625)


def test_a_first_look_far_from_an_empty_belief_grows_it():
    mapper = Mapper(small_config(), lattice_origin=(1.0, 1.0))
    mapper.update(Pose(40.0, 40.0))
    assert mapper.stuck
    mapper.belief.assign(np.zeros((20, 20), dtype=np.int8), (35.0, 35.0))
    mapper.update(Pose(40.0, 40.0))
    assert not mapper.stuck


def test_a_square_that_the_grid_cuts_off_is_only_partly_known():
    # Cells up to x = 4.5: the third column of squares begins at 4 m, its lattice points lie at 5 m.
    plain = small_config(viewpoint_spacing=2.0, resolution=0.5)
    cells = np.zeros((12, 9), dtype=np.int8)
    small, large = (Mapper(plain, lattice_origin=(1.0, 1.0)) for _ in range(2))
    small.belief.assign(cells, (0.0, 0.0))
    large.belief.assign(np.pad(cells, ((0, 0), (0, 5)), constant_values=-1), (0.0, 0.0))
    for mapper in (small, large):
        mapper.update(Pose(1.0, 1.0))
        # The strip right of x = 4 does not hold its lattice points and may become more.
        assert sorted(set(mapper.viewpoints[:, 0].tolist())) == [1.0, 3.0]


def test_pieces_that_wait_no_longer_are_reached_although_no_cell_has_changed():
    mapper = Mapper(small_config(viewpoint_spacing=2.0, resolution=0.5), lattice_origin=(1.0, 1.0))
    mapper.belief.assign(np.pad(np.zeros((12, 9), dtype=np.int8), ((0, 0), (0, 5)), constant_values=-1), (0.0, 0.0))
    mapper.update(Pose(1.0, 1.0))
    graph, robot = mapper._graph, mapper.belief.subcells((1.0, 1.0))
    assert len(graph.reachable()[0]) == 6
    graph.update(None, NOTHING_LOST, robot, everywhere=True)
    order, _, edges = graph.reachable()
    assert len(order) == len(edges.pointer) - 1 == 9
    assert graph.reachable()[2] is edges  # nothing is worked out twice
    graph.update(None, NOTHING_LOST, robot)
    assert len(graph.reachable()[0]) == 6


def test_a_robot_between_equally_near_viewpoints_counts_as_at_the_first_of_them():
    mapper = Mapper(small_config(viewpoint_spacing=2.0, resolution=0.5), lattice_origin=(1.0, 1.0))
    mapper.belief.assign(np.zeros((12, 12), dtype=np.int8), (0.0, 0.0))
    for pose, viewpoint in (((2.0, 2.0), (1.0, 1.0)), ((4.0, 3.0), (3.0, 3.0)), ((4.1, 2.0), (5.0, 1.0))):
        mapper.update(Pose(*pose))
        assert mapper.position(mapper.robot) == viewpoint


def test_a_gap_beside_the_robot_is_looked_into_although_the_robot_is_near():
    # A corridor with a gap of one cell in its wall; the robot stands near the gap and does not see into it.
    cells = np.full((12, 20), 100, dtype=np.int8)
    cells[2:5, 1:19] = 0
    cells[5:7, 10] = 0
    cells[6, [9, 11]] = cells[7, 9:12] = -1
    mapper = Mapper(small_config(viewpoint_spacing=1.0, resolution=0.1), lattice_origin=(0.5, 0.3))
    mapper.belief.assign(cells, (0.0, 0.0))
    mapper.update(Pose(0.85, 0.45))
    observation = mapper.observe()
    assert mapper.viewpoints[observation.utility > 0].round(9).tolist() == [[1.05, 0.55]]
    assert not observation.visited[observation.utility > 0].any()
    mapper.update(Pose(1.05, 0.55))  # a look from there that shows nothing is enough
    assert not mapper.observe().utility.any() or mapper.observe().visited[mapper.observe().utility > 0].all()


def test_a_single_frontier_keeps_no_other_of_its_piece_from_a_look():
    # Two gaps in a wall, each beside the robot's piece; one shows a single frontier and leads nowhere.
    cells = np.full((14, 24), 100, dtype=np.int8)
    cells[2:5, 1:23] = 0
    cells[5, 4] = 0  # a niche whose corners are unknown: one frontier
    cells[6, 3] = cells[6, 5] = -1
    cells[5:7, 18:20] = 0
    cells[6, [17, 20]] = cells[7, 17:21] = -1
    mapper = Mapper(small_config(viewpoint_spacing=3.0, resolution=0.1), lattice_origin=(1.2, 0.3))
    mapper.belief.assign(cells, (0.0, 0.0))
    mapper.update(Pose(1.25, 0.35))
    observation = mapper.observe()
    places = mapper.viewpoints[(observation.utility > 0) & ~observation.visited]
    assert (places[:, 0] > 1.5).all() and len(places) == 1


def test_a_gap_one_cell_wide_is_looked_into_by_a_robot_without_size():
    cells = np.full((12, 20), 100, dtype=np.int8)
    cells[2:5, 1:19] = 0
    cells[5, 10] = 0
    cells[6, 9:11] = -1
    mapper = Mapper(small_config(viewpoint_spacing=1.0, resolution=0.1), lattice_origin=(0.5, 0.3))
    mapper.belief.assign(cells, (0.0, 0.0))
    mapper.update(Pose(0.55, 0.35))
    assert len(mapper.frontiers) == 1
    observation = mapper.observe()
    assert mapper.viewpoints[observation.utility > 0].round(9).tolist() == [[1.05, 0.55]]


# A corridor that continues at its right end; at its left end an alcove of the same piece that leads somewhere, too.
ALCOVE = np.full((44, 110), 100, dtype=np.int8)
ALCOVE[14:26, 1:100] = 0
ALCOVE[14:26, 100:106] = -1
ALCOVE[26:33, 4:10] = 0
ALCOVE[33:40, 2:12] = -1


def alcove_mapper(**changes: float) -> Mapper:
    mapper = Mapper(small_config(viewpoint_spacing=4.0, resolution=0.1, **changes), lattice_origin=(2.0, 2.0))
    mapper.belief.assign(ALCOVE, (0.0, 0.0))
    return mapper


def places_to_look_from(mapper: Mapper) -> list[tuple[float, float]]:
    observation = mapper.observe()
    return [tuple(p) for p in mapper.viewpoints[(observation.utility > 0) & ~observation.visited].round(2).tolist()]


def test_a_robot_with_a_radius_looks_past_a_corner_of_a_piece_as_soon_as_it_has_been_there():
    mapper = alcove_mapper(robot_radius=0.15)
    mapper.update(Pose(6.0, 2.0))
    # The robot was not in the piece of the alcove, and might see into it from the viewpoint there.
    usual, end = places_to_look_from(mapper)
    assert usual == (2.0, 2.0) and end[0] > 8.0
    mapper.update(Pose(*usual))
    early, late = places_to_look_from(mapper)
    assert late == end
    assert 0.4 < early[0] < 1.0 and 2.6 < early[1] < 3.3
    mapper.update(Pose(*early))
    # A look from there that shows nothing new is enough.
    assert places_to_look_from(mapper) == [late]


def test_a_robot_without_a_radius_looks_past_corners_when_nothing_else_is_left():
    mapper = alcove_mapper()
    for x in (6.0, 2.0):
        mapper.update(Pose(x, 2.0))
    (end,) = places_to_look_from(mapper)
    assert end[0] > 8.0
    mapper.update(Pose(*end))
    late = min(places_to_look_from(mapper))
    assert 0.4 < late[0] < 1.0 and 2.6 < late[1] < 3.3


def test_an_early_look_must_show_enough():
    mapper = alcove_mapper(robot_radius=0.15, least_utility=7)
    mapper.update(Pose(2.0, 2.0))
    # Six frontiers show in the alcove, and twelve at the end of the corridor.
    assert len(mapper.frontiers) == 18
    places = places_to_look_from(mapper)
    assert places and all(y < 2.6 for _, y in places)
