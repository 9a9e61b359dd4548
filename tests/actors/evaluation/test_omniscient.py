from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from actors.environment import Environment
from actors.evaluation.episode import run_episode
from actors.evaluation.omniscient import OmniscientReference
from actors.evaluation.rehearsal import known_part
from actors.evaluation.route_graph import RouteGraph
from actors.maps.generators import make_generator
from actors.maps.grid_map import GridMap
from actors.simulators.grid import GridSimulator
from actors.tasks import make_goal
from common.config import MappingConfig, RewardConfig, SimulatorConfig, TaskConfig
from common.errors import MapError
from common.mapping.mapper import Mapper
from common.planners.exploration.greedy import GreedyPlanner
from common.planners.exploration.nearest import NearestPlanner
from tests.actors.worlds import draw

MAPPING = MappingConfig(resolution=0.5, sensor_range=8.0, viewpoint_spacing=2.0, beacon_range=8.0)
SIMULATOR = SimulatorConfig(name="grid")
CORRIDOR = draw("#" * 34, "#S" + "." * 31 + "#", "#" * 34, lattice=(1.5, 1.5))
FORK = draw("#" * 36, "#....." + "." * 10 + "S" + "." * 18 + "#", "#" * 36, lattice=(0.5, 1.5))
HALLWAY = draw("#" * 26, "#S" + "." * 21 + "T.#", "#" * 26, lattice=(1.5, 1.5))
WALL = draw(
    "############",
    "#S...#....T#",
    "#....#.....#",
    "#....#.....#",
    "#..........#",
    "############",
    lattice=(1.5, 1.5),
)


def drive(world, mapping=MAPPING, simulator=SIMULATOR, planner=None, seed=0, **task):
    config = TaskConfig(**{"unseen_area": 1.0, **task})
    reference = OmniscientReference(mapping, config, simulator, iterations=3000)
    environment = Environment(
        GridSimulator(simulator, mapping.sensor_range), mapping, make_goal(config), RewardConfig(), config.max_steps
    )
    if planner is None:
        reference.prepare(world, seed)
        planner = reference
    return run_episode(environment, planner, world, seed=seed, time_limit=60.0)


def test_a_corridor_takes_its_length():
    outcome = drive(CORRIDOR)
    assert outcome.success
    # 32 m long, 8 m are seen ahead and 1 m may stay unseen; the lattice has 2 m.
    assert 22.0 <= outcome.distance <= 24.0


def test_the_shorter_arm_of_a_corridor_comes_first():
    outcome = drive(FORK)
    assert outcome.success
    # 16 m to the left, 18.5 m to the right: 8 to 8.5 m there and back, then 10 m, and not the other way round.
    xs = [x for x, _ in outcome.waypoints]
    assert xs[1] < xs[0]
    assert xs[-1] > xs[0]


@pytest.mark.parametrize("number", [0, 1])
def test_it_beats_a_planner_under_the_same_rules(number):
    world = make_generator("rooms", {"width": "320", "height": "320"}).world(number, 0.25)
    mapping = MappingConfig()
    own = drive(world, mapping=mapping, unseen_area=15.625)
    other = drive(world, mapping=mapping, unseen_area=15.625, planner=GreedyPlanner(mapping))
    assert own.success
    assert own.distance <= other.distance + 1e-6


def test_among_pillars_no_planner_that_knows_less_beats_it():
    """What is seen between them depends on where exactly the robot looks, and the known map has few viewpoints."""
    free = np.zeros((100, 100), dtype=bool)
    free[2:98, 2:98] = True
    for row in range(8, 96, 7):
        for column in range(8, 96, 7):
            free[98 - row : 100 - row, column : column + 2] = False
    world = GridMap("pillars", free, 0.25, (0.0, 0.0), (1.25, 23.75), None, None, (2.0, 23.0))
    mapping = MappingConfig()
    own = drive(world, mapping=mapping, unseen_area=15.625)
    other = drive(world, mapping=mapping, unseen_area=15.625, planner=NearestPlanner(mapping))
    assert own.success, own.reason
    assert own.distance <= other.distance + 1e-6


def test_noise_and_scans_on_the_way_are_rehearsed_too():
    world = make_generator("rooms", {"width": "320", "height": "240"}).world(0, 0.25)
    simulator = SimulatorConfig(name="grid", range_noise=0.02, sense_every=1.0)
    assert drive(world, mapping=MappingConfig(), simulator=simulator, seed=5, unseen_area=15.625).success


def test_the_shortest_path_is_driven_to_the_target():
    outcome = drive(HALLWAY, name="navigation", arrival_radius=0.1)
    assert outcome.success
    assert outcome.distance == pytest.approx(22.0)
    around = drive(WALL, name="navigation", arrival_radius=0.6)
    assert around.success
    # Down to the gap, through it and up again, by edges of at most 4.5 m; the straight way is 9 m.
    assert 10.0 < around.distance <= 13.0


def test_a_target_without_a_way_is_an_error():
    sealed = draw("############", "#S....#..T.#", "#.....#....#", "############", lattice=(1.5, 1.5))
    with pytest.raises(MapError, match="no way"):
        drive(sealed, name="navigation")


@pytest.mark.parametrize("task", ["exploration", "navigation"])
@pytest.mark.parametrize("resolution", [0.1, 0.3])
def test_cells_of_the_belief_may_be_others_than_those_of_the_map(task, resolution):
    # Cells of 0.3 m and 0.1 m whose borders lie elsewhere than the walls'.
    mapping = MappingConfig(resolution=resolution, sensor_range=8.0, viewpoint_spacing=2.0, robot_radius=0.25)
    outcome = drive(replace(PLAN, resolution=0.27, target=(15.6, 1.6)), mapping=mapping, name=task)
    assert outcome.success, outcome.reason


def test_a_target_where_the_robot_does_not_fit_is_approached():
    mapping = MappingConfig(resolution=0.5, sensor_range=8.0, viewpoint_spacing=2.0, robot_radius=1.0)
    room = draw("##########", *["#........#"] * 4, "#.S......#", "#.......T#", "##########", lattice=(0.5, 0.5))
    outcome = drive(room, mapping=mapping, name="navigation", arrival_radius=0.1)
    assert not outcome.success
    assert "route on the known map has ended" in outcome.reason
    assert outcome.distance > 4.0


def test_one_room_needs_no_route():
    room = draw("######", "#....#", "#.S..#", "#....#", "######", lattice=(0.5, 0.5))
    outcome = drive(room)
    assert outcome.success
    assert outcome.steps == 0
    assert outcome.distance == 0.0


def test_a_start_beside_the_lattice_joins_it():
    world = draw("#" * 20, "#..S" + "." * 15 + "#", "#" * 20, lattice=(0.5, 1.5))
    graph = RouteGraph.build(world, MAPPING)
    viewpoints = len(graph.graph)
    assert graph.start == viewpoints == len(graph) - 1
    far = int(graph.distances[graph.start][:viewpoints].argmax())
    nodes = graph.route([far])
    route = [graph.position(node) for node in nodes]
    assert all(abs(a[0] - b[0]) <= 4.48 for a, b in zip([world.start, *route], route, strict=False))
    assert graph.legs(nodes) == [[position] for position in route]


PLAN = draw(
    "################",
    "#......#.......#",
    "#.##...#..##...#",
    "#.##......##...#",
    "#......#.......#",
    "#S.....#.......#",
    "####.#####.#####",
    "#......#.......#",
    "#..#...#...#...#",
    "#.............T#",
    "################",
    resolution=0.25,
    lattice=(2.1, 1.7),
)
WITH_RADIUS = MappingConfig(resolution=0.25, sensor_range=8.0, robot_radius=0.3)


def test_every_way_of_a_route_is_as_long_as_the_distances_say():
    graph = RouteGraph.build(PLAN, WITH_RADIUS)
    for stop in range(len(graph.graph)):
        nodes = graph.route([stop])
        corners = [PLAN.start, *(place for leg in graph.legs(nodes) for place in leg)]
        length = sum(np.hypot(*np.subtract(a, b)) for a, b in pairwise(corners))
        assert length == pytest.approx(graph.distances[graph.start, stop], abs=1e-3)
        assert all(graph.graph.mapper.segment_free(a, b) for a, b in pairwise(corners))


def test_a_robot_with_a_radius_drives_its_route_through_doors():
    explored = drive(PLAN, mapping=WITH_RADIUS, unseen_area=0.5)
    assert explored.success
    assert explored.reason == "complete"
    arrived = drive(PLAN, mapping=WITH_RADIUS, name="navigation", arrival_radius=0.2)
    assert arrived.success


def test_only_what_the_robot_knows_to_be_free_is_one_decision():
    simulator = GridSimulator(SIMULATOR, 8.0)
    pose = simulator.reset(PLAN, 0)
    mapper = Mapper(WITH_RADIUS, lattice_origin=PLAN.lattice_origin)
    mapper.integrate(simulator.scan(), pose)
    mapper.update(pose)
    known, unknown, behind = (4.5, 5.5), (4.5, 3.5), (1.5, 3.0)
    assert known_part(mapper, pose.position, [known, unknown, behind]) == ([known], [unknown, behind])
    assert known_part(mapper, pose.position, [known]) == ([known], [])
    # Beyond what the sensor reaches: as far as it does.
    (stop,), rest = known_part(mapper, (1.5, 5.5), [(1.5, 5.5), (14.5, 5.5)][1:])
    assert rest == [(14.5, 5.5)]
    assert 1.5 < stop[0] < 6.8
    assert stop[1] == pytest.approx(5.5)
