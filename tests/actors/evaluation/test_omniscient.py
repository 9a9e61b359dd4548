import pytest

from actors.environment import Environment
from actors.evaluation.episode import run_episode
from actors.evaluation.omniscient import OmniscientReference
from actors.evaluation.true_graph import TrueGraph
from actors.maps.generators import make_generator
from actors.simulators.grid import GridSimulator
from actors.tasks import make_task
from common.config.schema import MappingConfig, RewardConfig, SimulatorConfig, TaskConfig
from common.errors import MapError
from common.planners.greedy import GreedyPlanner
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
        GridSimulator(simulator, mapping.sensor_range), mapping, make_task(config), RewardConfig(), config.max_steps
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


def test_one_room_needs_no_route():
    room = draw("######", "#....#", "#.S..#", "#....#", "######", lattice=(0.5, 0.5))
    outcome = drive(room)
    assert outcome.success
    assert outcome.steps == 0
    assert outcome.distance == 0.0


def test_a_start_beside_the_lattice_joins_it():
    world = draw("#" * 20, "#..S" + "." * 15 + "#", "#" * 20, lattice=(1.5, 1.5))
    graph = TrueGraph.build(world, 2.0)
    assert len(graph.lattice) in (graph.start, len(graph))
    far = int(graph.distances[graph.start][: len(graph.lattice)].argmax())
    route = [graph.position(node) for node in graph.route([far])]
    assert all(abs(a[0] - b[0]) <= 4.48 for a, b in zip([world.start, *route], route, strict=False))
