import heapq
from dataclasses import replace

import numpy as np
import pytest

from actors.driver import Choice, ExpertDriver
from actors.environment import Environment
from actors.episode import Role, run_episode
from actors.expert import ExplorationExpert, make_expert
from actors.expert.base import leg_lengths
from actors.expert.true_graph import TrueGraph
from actors.expert.visibility import look_from_all
from actors.maps.sources import open_sources
from actors.simulators.grid import GridSimulator
from actors.tasks import make_goal
from common.config import MappingConfig, RewardConfig, SimulatorConfig, TaskConfig
from common.errors import HDError
from common.messages.experience import End
from common.tours.local_search import tour_length
from tests.actors.test_environment import BRANCHES, CORRIDOR, HALLWAY, MAPPING, environment
from tests.actors.worlds import draw

ROLE = Role("train", "grid")
CROSS = draw(
    "###########",
    "####...####",
    "####...####",
    "####...####",
    "#.........#",
    "#....S....#",
    "#.........#",
    "####...####",
    "####...####",
    "####...####",
    "###########",
    lattice=(1.5, 1.5),
)
COMB = draw(
    "#################",
    "#.###.###.###.###",
    "#.###.###.###.###",
    "#.###.###.###.###",
    "#.###.###.###.###",
    "#......S........#",
    "#################",
    lattice=(1.5, 1.5),
)


def best_distance(world, mapping, unseen_area):
    """Shortest walk over viewpoints after which little enough is unseen, by search over all (node, what was seen)."""
    graph = TrueGraph.build(world, mapping)
    sight = look_from_all(world.free, graph.points, mapping.sensor_range / world.resolution, 720)
    views = []
    for v in range(len(graph)):
        view = 0
        for k in range(sight.pointer[v], sight.pointer[v + 1]):
            view |= int(sight.mask[k]) << (64 * int(sight.tile[k]))
        views.append(view)
    first = int(np.argmin(np.hypot(*(graph.positions - world.start).T)))
    enough = int(np.count_nonzero(world.free)) - int(unseen_area / world.resolution**2 + 1e-6)
    queue = [(0.0, first, views[first])]
    done = set()
    while queue:
        distance, node, seen = heapq.heappop(queue)
        if seen.bit_count() >= enough:
            return distance
        if (node, seen) in done:
            continue
        done.add((node, seen))
        for k in range(graph.pointer[node], graph.pointer[node + 1]):
            other = int(graph.neighbours[k])
            heapq.heappush(queue, (distance + float(graph.lengths[k]), other, seen | views[other]))
    raise AssertionError("the world cannot be explored from its viewpoints")


@pytest.mark.parametrize("world", [CORRIDOR, CROSS, COMB], ids=["corridor", "cross", "comb"])
@pytest.mark.parametrize("unseen_area", [0.5, 3.0])
def test_the_expert_is_optimal_on_tiny_maps(world, unseen_area):
    mapping = MAPPING.model_copy(update={"sensor_range": 5.0})
    task = TaskConfig(unseen_area=unseen_area)
    env = Environment(
        GridSimulator(SimulatorConfig(name="grid", rays=720), 5.0),
        mapping,
        make_goal(task),
        RewardConfig(),
        64,
        make_expert(task, mapping),
    )
    report = run_episode(env, world, ExpertDriver(), ROLE, seed=0)
    assert report.success
    assert report.distance <= best_distance(world, mapping, unseen_area) + 1e-3


class NearestDriver:
    """Goes to the nearest useful viewpoint that was not visited, and keeps to it until it is reached or useless."""

    name = "policy"
    version = -1

    def __init__(self):
        self.goal = np.full(2, np.inf)

    def choose(self, observation, environment):
        mapper = environment.mapper
        distances = mapper.distances(observation.robot)[: observation.viewpoints]
        useful = (observation.utility > 0) & ~observation.visited
        same = useful & (np.hypot(*(mapper.viewpoints - self.goal).T) < 0.1)
        goal = int(np.argmin(np.where(same if same.any() else useful, distances, np.inf)))
        self.goal = mapper.viewpoints[goal]
        path = mapper.path(observation.robot, goal)
        waypoint = path[1] if len(path) > 1 else observation.waypoint_nodes()[0]
        return Choice(int(observation.beacon_nodes()[0]), int(waypoint), -1)


def test_the_expert_is_never_worse_than_going_to_the_nearest_viewpoint():
    source = open_sources(["generator:rooms?width=320&height=240"], 0.25, "exploration")
    mapping, task = MappingConfig(), TaskConfig()
    env = Environment(
        GridSimulator(SimulatorConfig(name="grid"), 20.0),
        mapping,
        make_goal(task),
        RewardConfig(),
        128,
        make_expert(task, mapping),
    )
    pairs = []
    for index in range(6):
        world = source.world(index)
        expert = run_episode(env, world, ExpertDriver(), ROLE, seed=0)
        nearest = run_episode(env, world, NearestDriver(), ROLE, seed=0)
        assert expert.success
        pairs.append((expert.distance, nearest.distance if nearest.success else np.inf))
        assert expert.distance <= nearest.distance + 1e-6
    assert np.mean([a for a, _ in pairs]) < 0.95 * np.mean([b for _, b in pairs if np.isfinite(b)])


@pytest.mark.parametrize(("task", "world"), [("exploration", CORRIDOR), ("navigation", HALLWAY)])
def test_the_remaining_distance_falls_by_what_was_driven(task, world):
    env = environment(task)
    env.reset(world, seed=0)
    driver = ExpertDriver()
    while env.end is End.NONE:
        before = env.remaining()
        choice = driver.choose(env._observation, env)
        step = env.step(choice.beacon, choice.waypoint)
        assert env.remaining() <= before - step.distance + 0.05
    assert env.success
    assert env.remaining() == 0.0


@pytest.mark.parametrize("task", ["exploration", "navigation"])
def test_the_way_is_nearly_as_long_as_was_said_at_the_start(task):
    env = environment(task)
    env.reset(BRANCHES, seed=0)
    driver = ExpertDriver()
    said, driven = env.remaining(), 0.0
    while env.end is End.NONE:
        before = env.remaining()
        choice = driver.choose(env._observation, env)
        step = env.step(choice.beacon, choice.waypoint)
        driven += step.distance
        # At the rim of what is known a viewpoint may lie beside the true one, and an edge may still be missing.
        assert env.remaining() <= before - step.distance + 0.25 * MAPPING.viewpoint_spacing
    assert env.success
    assert driven <= 1.05 * said


def test_the_navigation_expert_drives_the_shortest_way():
    env = environment("navigation", arrival_radius=0.1)
    env.reset(HALLWAY, seed=0)
    expert_label = env.expert_label()
    assert expert_label.remaining == pytest.approx(21.0 + 1.0, abs=0.01)
    observation = env._observation
    waypoints = observation.waypoint_nodes()
    best = waypoints[int(np.argmin(expert_label.cost))]
    assert env.mapper.position(int(best))[0] > HALLWAY.start[0]
    assert expert_label.beacon in observation.beacon_nodes()


def test_standing_still_is_never_the_plan():
    # The robot has seen all that its own viewpoint shows; an expert that counted it again would not move.
    env = environment(unseen_area=0.0)
    env.reset(CORRIDOR, seed=0)
    expert = ExplorationExpert(MAPPING, 0.0)
    expert.reset(CORRIDOR)
    for _ in range(3):
        expert_label = expert.label(env._observation, env.mapper.viewpoints, env.pose, env.coverage)
        assert expert_label.remaining > 20.0
        best = int(env._observation.waypoint_nodes()[int(np.argmin(expert_label.cost))])
        assert env.mapper.position(best)[0] > env.pose.x


def test_an_expert_without_a_map_says_so():
    env = environment()
    observation = env.reset(CORRIDOR, seed=0)
    for task in ("exploration", "navigation"):
        expert = make_expert(TaskConfig(name=task), MAPPING)
        with pytest.raises(HDError, match="reset"):
            expert.label(observation, env.mapper.viewpoints, env.pose, env.coverage)


FURNISHED = draw(
    "################",
    "#......#.......#",
    "#.##...#..##...#",
    "#.##......##...#",
    "#......#.......#",
    "#S.....#.......#",
    "####.#####.#####",
    "#......#.......#",
    "#..#...#...#...#",
    "#..............#",
    "################",
    resolution=0.25,
    lattice=(2.1, 1.7),
)


@pytest.mark.parametrize("task", ["exploration", "navigation"])
def test_the_expert_leads_a_robot_with_a_radius_through_doors(task):
    world = FURNISHED if task == "exploration" else replace(FURNISHED, target=(13.5, 1.5))
    mapping = MappingConfig(resolution=0.25, sensor_range=8.0, robot_radius=0.3)
    config = TaskConfig(name=task, unseen_area=0.5, arrival_radius=0.2)
    env = Environment(
        GridSimulator(SimulatorConfig(name="grid"), 8.0),
        mapping,
        make_goal(config),
        RewardConfig(),
        64,
        make_expert(config, mapping),
    )
    observation = env.reset(world, seed=0)
    bends = 0
    while env.end is End.NONE:
        positions = env.mapper.viewpoints
        legs = leg_lengths(observation, positions, positions, env.pose, 4.0)
        for node, leg in zip(observation.waypoint_nodes().tolist(), legs, strict=True):
            if node == observation.viewpoints:
                continue
            way = np.array([env.mapper.position(observation.robot), *env.mapper.way(observation.robot, node)])
            home = env.pose.distance_to(env.mapper.position(observation.robot))
            assert leg == pytest.approx(home + np.hypot(*np.diff(way, axis=0).T).sum(), abs=1e-3)
            bends += len(way) > 2
        choice = ExpertDriver().choose(observation, env)
        observation = env.step(choice.beacon, choice.waypoint).observation
    assert env.reason == "complete"
    assert bends > 0


def test_pieces_of_one_square_are_one_true_viewpoint():
    world = draw("######", "#.S..#", "#....#", "#....#", "#....#", "######", resolution=0.25, lattice=(3.0, 3.0))
    graph = TrueGraph.build(world, MappingConfig(resolution=0.25, viewpoint_spacing=4.0))
    assert len(graph) == 1
    nodes, places = graph.match(np.array([[2.0, 3.0], [4.6, 3.0], [3.0, 3.0], [0.5, 3.0]]))
    assert nodes.tolist() == [0, 0, 0, -1]
    assert places.tolist() == [[3.0, 3.0], [3.0, 3.0], [3.0, 3.0], [0.5, 3.0]]


def test_several_tours_repeat_and_are_never_longer_than_one(monkeypatch):
    mapping, task = MappingConfig(), TaskConfig()
    expert = ExplorationExpert(mapping, task.unseen_area)
    simulator = GridSimulator(SimulatorConfig(name="grid"), 20.0)
    env = Environment(simulator, mapping, make_goal(task), RewardConfig(), 40, expert)
    world = open_sources(["generator:rooms"], 0.25, "exploration").world(3)
    plan = expert._tour
    gained = []

    def compared(scanned, robot, coverage):
        found, allowed = plan(scanned, robot, coverage)
        again, _ = plan(scanned, robot, coverage)
        assert np.array_equal(found, again)
        tries, expert._tries = expert._tries, 1
        single, _ = plan(scanned, robot, coverage)
        expert._tries = tries
        distances = expert._distances
        gained.append(tour_length(distances, robot, single) - tour_length(distances, robot, found))
        return found, allowed

    monkeypatch.setattr(expert, "_tour", compared)
    run_episode(env, world, ExpertDriver(), ROLE, seed=0)
    assert len(gained) > 5
    assert min(gained) >= 0.0 and max(gained) > 0.0
