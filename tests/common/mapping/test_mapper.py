"""What a planner sees of the mapper, in worlds small enough to check by eye."""

from __future__ import annotations

import numpy as np
import pytest

from common.errors import MappingError
from common.geometry import Pose, Scan
from common.mapping.mapper import Mapper
from common.mapping.warmup import warm_up
from tests.common.mapping.worlds import scan_of, see, see_all, small_config, world_of


def room(rows: int = 24, columns: int = 24) -> np.ndarray:
    """One empty room; lattice points (1 + 2 i, 1 + 2 j) lie on cell corners well inside it at 0.5 m cells."""
    free = np.ones((rows, columns), dtype=np.bool_)
    free[[0, -1], :] = False
    free[:, [0, -1]] = False
    return free


def mapper_of(**changes) -> Mapper:
    return Mapper(small_config(**changes), lattice_origin=(1.0, 1.0))


def node_at(mapper: Mapper, x: float, y: float) -> int:
    far = np.hypot(*(mapper.viewpoints - (x, y)).T)
    assert far.min() < 1e-9, f"no viewpoint at ({x}, {y})"
    return int(np.argmin(far))


def edges_of(mapper: Mapper) -> dict[tuple[tuple[float, float], tuple[float, float]], float]:
    """Lengths of all edges by the places that they join; so that graphs with other node numbers compare."""
    viewpoints, edges = [tuple(p) for p in mapper.viewpoints.round(9).tolist()], mapper.adjacency
    starts = np.repeat(np.arange(len(viewpoints)), np.diff(edges.pointer))
    ends, lengths = edges.neighbours.tolist(), edges.lengths.round(9).tolist()
    return {(viewpoints[a], viewpoints[b]): length for a, b, length in zip(starts, ends, lengths, strict=True)}


def test_a_single_room_is_finished_after_one_look():
    mapper = Mapper(small_config(sensor_range=20.0), lattice_origin=(1.0, 1.0), bounds=(0.0, 0.0, 12.0, 12.0))
    see(mapper, room(), Pose(5.0, 5.0))
    observation = mapper.observe()
    assert mapper.explored_area == pytest.approx(11.0 * 11.0)
    assert len(mapper.frontiers) == 0
    assert observation.viewpoints == 36
    assert not observation.utility.any()
    assert not observation.beacon.any()
    assert mapper.viewpoints[observation.robot].tolist() == [5.0, 5.0]
    np.testing.assert_array_equal(np.flatnonzero(observation.visited), [observation.robot])
    # Inside the room every neighbour within sqrt(5) spacings is connected, and no other.
    assert len(observation.waypoint_nodes()) == len(mapper.adjacency.of(mapper.robot)) == 20
    assert not mapper.adjacency.bent.any()
    assert not observation.has_target


def test_a_corridor_is_a_line_with_a_beacon_at_its_unseen_end():
    free = np.zeros((5, 80), dtype=np.bool_)
    free[1:4, 1:79] = True
    mapper = mapper_of(beacon_range=20.0)
    see(mapper, free, Pose(3.0, 1.0))
    observation = mapper.observe()
    # At the unseen end walls are known whose square is not: its viewpoint stands where there is most space so far.
    on_lattice = mapper.viewpoints[:-1]
    assert on_lattice.tolist() == [[1.0 + 2.0 * i, 1.0] for i in range(len(on_lattice))]
    assert len(on_lattice) >= 5
    assert np.count_nonzero(observation.beacon) == 1
    assert observation.beacon_nodes().tolist() == np.flatnonzero(observation.beacon).tolist()
    np.testing.assert_array_equal(mapper.beacons, mapper.viewpoints[observation.beacon])
    assert mapper.frontiers[:, 0].min() > 9.0
    last = observation.viewpoints - 1
    assert mapper.path(observation.robot, last)[-1] == last
    np.testing.assert_allclose(mapper.distances(observation.robot)[:-1], np.abs(on_lattice[:, 0] - 3.0))


def test_an_edge_never_cuts_a_corner():
    free = world_of("""
        ####################
        #..................#
        #..................#
        #..................#
        #..................#
        #......#############
        #......#############
        #......#############
        #......#############
        #......#############
        #......#############
        #......#############
        ####################""")
    mapper = mapper_of()
    see_all(mapper, free, Pose(1.0, 1.0))
    assert {tuple(p) for p in mapper.viewpoints} == {
        (1.0, 1.0), (3.0, 1.0), (1.0, 3.0), (3.0, 3.0), (1.0, 5.0), (3.0, 5.0), (5.0, 5.0), (7.0, 5.0), (9.0, 5.0)
    }  # fmt: skip
    neighbours = {mapper.position(node) for node in mapper.adjacency.of(node_at(mapper, 3.0, 3.0))}
    # (5, 5) and (7, 5) from (3, 3) would cut the corner at (3.5, 4).
    assert neighbours == {(3.0, 1.0), (1.0, 1.0), (1.0, 3.0), (1.0, 5.0), (3.0, 5.0)}
    assert not mapper.segment_free((3.0, 3.0), (5.0, 5.0))
    assert mapper.segment_free((3.0, 3.0), (3.0, 5.0))
    pairs = mapper.edges
    assert (pairs[:, 0] < pairs[:, 1]).all()
    assert len(pairs) == mapper.observe().degree.sum()
    assert [node_at(mapper, 3.0, 3.0), node_at(mapper, 3.0, 5.0)] in pairs.tolist()


def test_a_robot_off_the_lattice_uses_the_nearest_viewpoint_in_sight():
    free = room()
    free[:14, 12] = False  # a wall at x = 6.0 .. 6.5, open above y = 7
    mapper = mapper_of()
    see_all(mapper, free, Pose(5.9, 2.9))
    assert mapper.position(mapper.robot) == (5.0, 3.0)
    mapper.update(Pose(6.7, 2.9))  # nearer to (7, 3) by far
    assert mapper.position(mapper.robot) == (7.0, 3.0)
    # From just above the wall's end (5, 5) is nearer in no way that is free.
    mapper.update(Pose(6.55, 6.3))
    assert mapper.position(mapper.robot) == (7.0, 7.0)


def test_visited_needs_half_a_spacing():
    mapper = mapper_of()
    cells = np.where(room(), 0, 100).astype(np.int8)
    cells[:, 18:] = -1  # something is left to look at
    mapper.belief.assign(cells, (0.0, 0.0))
    mapper.update(Pose(4.0, 4.0))  # the middle of four viewpoints: 1.41 m from each
    assert not mapper.observe().visited.any()
    mapper.update(Pose(4.2, 5.0))
    assert np.flatnonzero(mapper.observe().visited).tolist() == [node_at(mapper, 5.0, 5.0)]
    mapper.update(Pose(7.0, 7.9))
    assert np.count_nonzero(mapper.observe().visited) == 2


def test_negative_coordinates_are_like_any_other():
    free = room()
    plain = mapper_of()
    see_all(plain, free, Pose(5.0, 5.0))
    shifted = Mapper(small_config(), lattice_origin=(-999.0, -59.0))
    shifted.belief.assign(np.where(free, 0, 100).astype(np.int8), (-1000.0, -60.0))
    shifted.update(Pose(-995.0, -55.0))
    np.testing.assert_array_equal(shifted.observe().offsets, plain.observe().offsets)
    np.testing.assert_array_equal(shifted.edges, plain.edges)
    np.testing.assert_allclose(shifted.viewpoints, plain.viewpoints - (1000.0, 60.0))


def test_a_pocket_without_an_edge_into_it_is_not_observed():
    free = room()
    free[:, 12] = False
    mapper = mapper_of()
    see_all(mapper, free, Pose(3.0, 3.0))
    assert mapper.viewpoints[:, 0].max() == 5.0
    left = mapper.observe().viewpoints
    mapper.update(Pose(9.0, 3.0))
    assert mapper.viewpoints[:, 0].min() == 7.0
    assert mapper.observe().viewpoints == left
    assert np.isfinite(mapper.distances(mapper.robot)).all()


def test_a_wall_that_appears_on_an_edge_removes_it_and_what_was_seen_through_it():
    mapper = mapper_of(sensor_range=6.0)
    cells = np.where(room(), 0, 100).astype(np.int8)
    cells[:, 16:] = -1
    mapper.belief.assign(cells, (0.0, 0.0))
    mapper.update(Pose(3.0, 5.0))
    assert mapper.segment_free((3.0, 5.0), (7.0, 5.0))
    before, edges = mapper.observe(), edges_of(mapper)
    assert before.utility[node_at(mapper, 3.0, 5.0)] > 0
    mapper.belief.assign(np.full((22, 1), 100, dtype=np.int8), (6.0, 0.5))
    mapper.update(Pose(3.0, 5.0))
    after = mapper.observe()
    assert not mapper.segment_free((3.0, 5.0), (7.0, 5.0))
    assert mapper.viewpoints[:, 0].max() == 5.0
    assert not after.utility.any()
    assert not after.beacon.any()
    mapper.belief.assign(np.zeros((22, 1), dtype=np.int8), (6.0, 0.5))
    mapper.update(Pose(3.0, 5.0))
    assert edges_of(mapper) == edges
    np.testing.assert_array_equal(mapper.observe().utility, before.utility)


def test_a_viewpoint_that_turns_out_to_be_a_wall_moves_within_its_square():
    mapper = mapper_of()
    see_all(mapper, room(), Pose(3.0, 3.0))
    count = mapper.observe().viewpoints
    beam = Scan(np.array([2.1], dtype=np.float32), 0.0, 0.0, 9.0)
    mapper.integrate(beam, Pose(3.0, 5.0))  # now there is a wall in the cell of (5, 5)
    mapper.update(Pose(3.0, 3.0))
    assert mapper.observe().viewpoints == count
    inside = (np.abs(mapper.viewpoints - 5.0) < 1.0).all(axis=1)
    assert mapper.viewpoints[inside].tolist() == [[4.75, 4.75]]


def target_world() -> tuple[Mapper, np.ndarray]:
    free = room()
    free[:18, 12] = False  # a wall with a way round at the top
    return Mapper(small_config(), lattice_origin=(1.0, 1.0), target=(9.3, 2.9)), free


def test_a_target_behind_a_wall_is_tied_to_beacons_until_it_is_seen():
    mapper, free = target_world()
    see(mapper, free, Pose(3.0, 3.0))
    observation = mapper.observe()
    n = observation.viewpoints
    assert observation.has_target
    assert not observation.target_known
    assert mapper.position(n) == (9.3, 2.9)
    np.testing.assert_allclose(observation.target_offset, [3.15, -0.05], rtol=1e-6)
    assert set(observation.target_links.tolist()) == set(observation.beacon_nodes().tolist())
    assert n not in observation.waypoint_nodes()
    see(mapper, free, Pose(5.0, 10.9))
    see(mapper, free, Pose(9.0, 9.0))
    observation = mapper.observe()
    n = observation.viewpoints
    assert observation.target_known
    assert observation.beacon_nodes()[-1] == n
    assert mapper.beacons[-1].tolist() == [9.3, 2.9]
    links = mapper.viewpoints[observation.target_links]
    assert (np.hypot(*(links - (9.3, 2.9)).T) <= 5**0.5 * 2.0).all()
    assert [9.0, 3.0] in links.tolist()
    assert n not in observation.waypoint_nodes()  # the robot at (9, 9) has no link to it
    mapper.update(Pose(9.0, 5.0))
    assert n in mapper.observe().waypoint_nodes()
    distances = mapper.distances(mapper.robot)
    assert distances[n] == pytest.approx(np.hypot(0.3, 2.1))
    assert mapper.path(mapper.robot, n) == [mapper.robot, n]


def test_a_known_target_without_a_viewpoint_in_sight_is_not_announced_as_known():
    free = room()
    free[:, 12] = False
    mapper = Mapper(small_config(), lattice_origin=(1.0, 1.0), target=(9.0, 3.0))
    see_all(mapper, free, Pose(3.0, 3.0))  # the target's cell is free, but in the other half
    observation = mapper.observe()
    assert not observation.target_known
    assert observation.target_links.size == 0
    assert mapper.distances(mapper.robot)[observation.viewpoints] == np.inf
    assert mapper.path(mapper.robot, observation.viewpoints) == []


def test_many_looks_may_be_integrated_before_one_update():
    free = room()
    once, often = mapper_of(), mapper_of()
    poses = [Pose(3.0, 3.0), Pose(8.0, 3.0, 1.0), Pose(7.3, 9.1, -2.0)]
    for pose in poses:
        see(often, free, pose)
    new = [once.integrate(scan_of(free, 0.5, (0.0, 0.0), p, range_max=10.0, beams=720), p) for p in poses]
    once.update(poses[-1])
    assert sum(new) == once.belief.known_cells == often.belief.known_cells
    for name in ("offsets", "utility", "beacon", "degree", "neighbours"):
        np.testing.assert_array_equal(getattr(once.observe(), name), getattr(often.observe(), name))


def test_an_observation_does_not_change_when_the_robot_goes_on():
    mapper = mapper_of(sensor_range=4.0)
    see(mapper, room(), Pose(3.0, 3.0))
    observation = mapper.observe()
    names = ("offsets", "utility", "visited", "beacon", "degree", "neighbours", "target_links")
    before = {name: getattr(observation, name).copy() for name in names}
    for x in (5.0, 7.0, 9.0):
        see(mapper, room(), Pose(x, 5.0))
    for name in names:
        np.testing.assert_array_equal(getattr(observation, name), before[name])


def test_growth_keeps_visited_flags_and_node_positions():
    free = np.zeros((7, 400), dtype=np.bool_)
    free[1:6, 1:399] = True
    mapper = mapper_of(sensor_range=6.0)
    for x in (99.0, 101.0, 103.0, 60.0, 140.0, 101.0):
        see(mapper, free, Pose(x, 1.0))
    observation = mapper.observe()
    assert mapper.belief.generation > 1
    visited = mapper.viewpoints[observation.visited]
    assert visited.tolist() == [[99.0, 1.0], [101.0, 1.0], [103.0, 1.0]]
    assert mapper.position(observation.robot) == (101.0, 1.0)


def test_accessors_stay_with_the_last_update_while_scans_come_in():
    free = np.zeros((7, 400), dtype=np.bool_)
    free[1:6, 1:399] = True
    mapper = mapper_of(sensor_range=6.0)
    see(mapper, free, Pose(99.0, 1.0))
    frontiers, viewpoints = mapper.frontiers, mapper.viewpoints
    mapper.integrate(Scan(np.array([np.inf], dtype=np.float32), 0.0, 0.0, 6.0), Pose(50.0, 1.0))
    np.testing.assert_array_equal(mapper.frontiers, frontiers)
    np.testing.assert_array_equal(mapper.viewpoints, viewpoints)


def test_a_robot_without_any_viewpoint_in_reach_is_stuck_and_says_so():
    mapper = mapper_of()
    with pytest.raises(MappingError, match="call update"):
        mapper.observe()
    mapper.update(Pose(5.0, 5.0))
    assert mapper.stuck
    assert mapper.robot == -1
    assert len(mapper.viewpoints) == len(mapper.edges) == len(mapper.beacons) == len(mapper.frontiers) == 0
    with pytest.raises(MappingError, match=r"\(5.00, 5.00\) is not in known free space"):
        mapper.observe()
    see(mapper, room(), Pose(5.0, 5.0))
    assert not mapper.stuck
    mapper.update(Pose(500.0, 5.0))
    assert mapper.stuck
    mapper.update(Pose(5.0, 5.0))
    assert not mapper.stuck


@pytest.mark.parametrize("node", [-1, 36, 10**6])
def test_unknown_nodes_are_refused(node):
    mapper = mapper_of()
    see_all(mapper, room(), Pose(5.0, 5.0))
    for ask in (mapper.position, mapper.distances, lambda n: mapper.path(0, n)):
        with pytest.raises(MappingError, match="there is no node"):
            ask(node)


@pytest.mark.parametrize(
    "arguments", [{"lattice_origin": (np.nan, 0.0)}, {"lattice_origin": (0.0, 0.0), "target": (np.inf, 1.0)}]
)
def test_positions_that_are_not_finite_are_refused(arguments):
    with pytest.raises(MappingError, match="must be finite"):
        Mapper(small_config(), **arguments)
    with pytest.raises(MappingError, match="a pose must be finite"):
        mapper_of().update(Pose(np.nan, 0.0))


def test_too_many_viewpoints_for_an_observation_are_refused():
    mapper = mapper_of(viewpoint_spacing=1.0, sensor_range=2.0, beacon_range=2.0)
    mapper.belief.assign(np.zeros((300, 300), dtype=np.int8), (0.0, 0.0))
    with pytest.raises(MappingError, match="raise mapping.viewpoint_spacing"):
        mapper.update(Pose(5.0, 5.0))


def test_segments_outside_the_belief_are_not_free():
    mapper = mapper_of()
    see_all(mapper, room(), Pose(5.0, 5.0))
    assert mapper.segment_free((1.0, 1.0), (11.2, 11.2))
    assert not mapper.segment_free((1.0, 1.0), (300.0, 1.0))
    assert not mapper.segment_free((-300.0, 1.0), (300.0, 1.0))


def test_warm_up_runs_all_kernels():
    warm_up()
