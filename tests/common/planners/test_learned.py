import dataclasses

import numpy as np
import pytest

from common.config import MappingConfig, NetworkConfig
from common.errors import CheckpointError, ConfigError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.network.parameters import initial_parameters
from common.planners.base import Status, mapping_for, with_deputies
from common.planners.learned import LearnedPlanner
from common.planners.registry import make_planner
from common.policies.policy_file import PolicyCard, write_policy
from common.policies.shipped import shipped_policy, shipped_tasks
from tests.common.planners.rollout import drawn, explore, navigate

CONFIG = MappingConfig(resolution=0.5)
NETWORK = NetworkConfig(width=16, heads=2, layers=1)
WORLD = drawn(["############", "#S.....#...#", "#..........#", "#......#...#", "############"])


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    path = tmp_path_factory.mktemp("policy") / "policy.safetensors"
    card = PolicyCard("test", "exploration", NETWORK, CONFIG, 1, 0, 0, False, "abc", "now")
    write_policy(path, initial_parameters(NETWORK, 0), card)
    return path


def test_a_policy_that_cannot_be_written_leaves_nothing_behind(tmp_path):
    (tmp_path / "policy.safetensors").mkdir()
    card = PolicyCard("test", "exploration", NETWORK, CONFIG, 1, 0, 0, False, "abc", "now")
    with pytest.raises(CheckpointError, match="cannot write the policy"):
        write_policy(tmp_path / "policy.safetensors", initial_parameters(NETWORK, 0), card)
    assert [path.name for path in tmp_path.iterdir()] == ["policy.safetensors"]


def test_a_policy_explores_under_the_rules_of_the_protocol(policy):
    planner = make_planner("hdplanner", CONFIG, policy=policy)
    # `explore` checks every waypoint: known free, in sight, one edge long.
    episode = explore(planner, WORLD, CONFIG, max_steps=40, rays=360)
    assert planner.name == "hdplanner"
    assert episode.plans[0].status is Status.GOING
    assert episode.plans[0].beacon is not None
    again = explore(planner, WORLD, CONFIG, max_steps=40, rays=360)
    assert again.waypoints == episode.waypoints
    bare = make_planner("hdplanner-bare", CONFIG, policy=policy)
    explore(bare, WORLD, CONFIG, max_steps=40, rays=360)
    assert bare.name == "hdplanner-bare"
    assert bare.rule_applied == 0


def test_a_policy_drives_up_to_a_target_where_the_robot_does_not_fit():
    config = MappingConfig(resolution=0.5, robot_radius=0.6)
    room = drawn(["########", "#S....T#", "#......#", "########"])
    beside_the_wall = dataclasses.replace(room, target=(room.size[0] - 4.3, room.target[1]))
    assert beside_the_wall.is_free(beside_the_wall.target)
    assert navigate(make_planner("hdplanner-bare", config), beside_the_wall, config).complete


def test_the_rule_against_cycles_ends_them_and_is_named_and_counted(policy):
    plain = explore(make_planner("hdplanner-bare", CONFIG, policy=policy), WORLD, CONFIG, max_steps=60, rays=360)
    planner = make_planner("hdplanner", CONFIG, policy=policy)
    ruled = explore(planner, WORLD, CONFIG, max_steps=60, rays=360)
    assert ruled.complete
    if not plain.complete:
        assert planner.rule_applied > 0
    planner.reset("exploration", None, 0)
    assert planner.rule_applied == 0


def test_a_robot_beside_the_lattice_gets_valid_waypoints(policy):
    start = (WORLD.start[0] + 1.3, WORLD.start[1] - 0.8)
    beside = type(WORLD)("beside", WORLD.free, 0.5, (0.0, 0.0), start, None, None, WORLD.lattice_origin)
    episode = explore(make_planner("hdplanner", CONFIG, policy=policy), beside, CONFIG, max_steps=40, rays=360)
    assert episode.steps > 0


def test_one_room_is_complete(policy):
    room = drawn(["#####", "#S..#", "#...#", "#####"])
    planner = LearnedPlanner(CONFIG, policy=policy)
    episode = explore(planner, room, CONFIG, unseen_area=0.0, max_steps=30, rays=360)
    assert episode.complete or episode.status is Status.COMPLETE


def test_what_is_missing_is_said(policy, tmp_path):
    with pytest.raises(CheckpointError, match="cannot read"):
        make_planner("hdplanner", CONFIG, policy=tmp_path / "none.safetensors")
    with pytest.raises(ConfigError, match="not navigation"):
        LearnedPlanner(CONFIG, policy=policy).reset("navigation", (1.0, 1.0), 0)


def test_without_a_policy_the_shipped_one_of_the_task_is_used():
    planner = LearnedPlanner(MappingConfig())
    for task in sorted(planner.tasks):
        planner.reset(task, (1.0, 1.0) if task == "navigation" else None, 0)
        assert planner.card is not None
        assert planner.card.task == task
    assert planner.tasks == shipped_tasks()
    with pytest.raises(CheckpointError, match="no policy is shipped for the task 'cleaning'"):
        shipped_policy("cleaning")


@pytest.mark.parametrize(
    ("task", "target", "names"),
    [
        ("exploration", None, ["hdplanner", "tour", "nearest", "greedy"]),
        ("navigation", (1.0, 1.0), ["hdplanner", "dstar_lite"]),
    ],
)
def test_whoever_may_decide_in_its_place_can_be_prepared(task, target, names):
    planner = make_planner("hdplanner", MappingConfig())
    planner.reset(task, target, seed=0)
    assert [each.name for each in with_deputies(planner)] == names


def test_another_mapping_is_warned_of(policy, caplog):
    LearnedPlanner(MappingConfig(resolution=0.5, sensor_range=12.0), policy=policy)
    assert "sensor_range 20.0 (here 12.0)" in caplog.text
    assert np.isfinite(LearnedPlanner(CONFIG, policy=policy).card.version)


def test_a_policy_brings_the_utilities_that_it_was_trained_with(tmp_path):
    trained = MappingConfig(resolution=0.25, utility_range=16.0, min_utility=8, least_utility=2)
    card = PolicyCard("test", "exploration", NETWORK, trained, 1, 0, 0, False, "abc", "now")
    path = tmp_path / "policy.safetensors"
    write_policy(path, initial_parameters(NETWORK, 0), card)
    given = MappingConfig(resolution=0.5, sensor_range=10.0, beacon_range=10.0)
    mapping = mapping_for(LearnedPlanner(given, policy=path), "exploration", given)
    assert (mapping.utility_range, mapping.min_utility, mapping.least_utility) == (8.0, 4, 1)
    assert (mapping.resolution, mapping.sensor_range, mapping.beacon_range) == (0.5, 10.0, 10.0)
    assert mapping_for(make_planner("greedy", given), "exploration", given) is given


def test_the_rule_against_cycles_leads_an_untrained_navigator_to_its_target(tmp_path):
    """Random weights wander; every detour of the rule is one step of a classical search, which arrives."""
    world = drawn(
        ["###########", "#S..#.....#", "#...#.##..#", "#...#.#T..#", "#.....##..#", "#.........#", "###########"]
    )
    card = PolicyCard("test", "navigation", NETWORK, CONFIG, 1, 0, 0, False, "abc", "now")
    path = tmp_path / "policy.safetensors"
    write_policy(path, initial_parameters(NETWORK, 3), card)
    bare = navigate(make_planner("hdplanner-bare", CONFIG, policy=path), world, CONFIG, max_steps=60, rays=360)
    planner = make_planner("hdplanner", CONFIG, policy=path)
    ruled = navigate(planner, world, CONFIG, max_steps=60, rays=360)
    assert ruled.complete
    assert bare.complete or planner.rule_applied > 0


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (
            {"sensor_range": 10.0},
            "viewpoints 2 m apart at a sensor range of 10 m (here 4 m: set mapping.viewpoint_spacing=2)",
        ),
        ({"viewpoint_spacing": 1.0}, "viewpoints 4 m apart at a sensor range of 20 m (here 1 m: set"),
        ({"viewpoint_spacing": 4.5}, ""),
        ({"robot_radius": 0.3}, ""),
    ],
)
def test_viewpoints_that_are_not_as_in_training_are_warned_of(policy, caplog, given, words):
    LearnedPlanner(MappingConfig(resolution=0.5, **given), policy=policy)
    assert words in caplog.text
    assert bool(words) == bool(caplog.text)


def test_a_robot_whose_viewpoint_is_the_only_one_drives_onto_it_before_it_gives_up(policy):
    """A single wide square: what is left is seen from its one viewpoint or not at all."""
    config = CONFIG.model_copy(update={"viewpoint_spacing": 12.0, "sensor_range": 3.0})
    mapper = Mapper(config, lattice_origin=(6.0, 6.0))
    cells = np.full((24, 24), 0, dtype=np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    cells[10:14, -1] = -1
    mapper.belief.assign(cells, (0.0, 0.0))
    planner = LearnedPlanner(config, policy=policy)
    pose = Pose(9.5, 9.5)
    mapper.update(pose)
    assert len(mapper.viewpoints) == 1
    assert mapper.observe().utility.any() or not len(mapper.frontiers)
    plan = planner.plan(mapper, pose)
    while plan.status is Status.GOING:
        pose = Pose(*plan.waypoint)
        mapper.update(pose)
        assert len(mapper.viewpoints) == 1
        plan = planner.plan(mapper, pose)
    assert plan.status is Status.COMPLETE
