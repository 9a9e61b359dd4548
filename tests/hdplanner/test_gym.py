"""The Gymnasium environment, by Gymnasium's own checker and as a learner uses it."""

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="Gymnasium is not installed")

import gymnasium
from gymnasium.utils.env_checker import check_env

from common.errors import ConfigError, HDError
from hdplanner.gym import PlanningEnv

SMALL = ["maps.train=generator:rooms?width=320&height=240"]


@pytest.fixture
def env():
    with_small_worlds = PlanningEnv(SMALL, max_viewpoints=128)
    yield with_small_worlds
    with_small_worlds.close()


def episode(env, seed):
    """Run an episode of allowed random actions and return what was seen and earned."""
    observation, info = env.reset(seed=seed)
    env.action_space.seed(seed)
    seen = [(observation, 0.0, info)]
    while True:
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample(info["action_mask"]))
        seen.append((observation, reward, info))
        if terminated or truncated:
            return seen, terminated


def test_gymnasiums_own_checker_is_content():
    env = gymnasium.make("hdplanner.gym:HDPlanner-v0", settings=SMALL, render_mode="rgb_array")
    check_env(env.unwrapped)
    env.close()


@pytest.mark.parametrize("task", ["exploration", "navigation"])
def test_allowed_actions_lead_to_an_end(task):
    env = PlanningEnv([*SMALL, f"task.name={task}"], max_viewpoints=128)
    seen, terminated = episode(env, 3)
    assert terminated
    assert seen[-1][2]["reason"] == "complete"
    assert seen[-1][2]["success"]
    assert all(not info["invalid_action"] for _, _, info in seen)
    assert all(env.observation_space.contains(observation) for observation, _, _ in seen)
    assert sum(reward for _, reward, _ in seen) == pytest.approx(env._stage.environment.total_reward)
    targets = [observation["nodes"][:, 5].sum() for observation, _, _ in seen]
    assert set(targets) == {1.0 if task == "navigation" else 0.0}
    env.close()


def test_the_seed_alone_decides_an_episode(env):
    first, again, other = (episode(env, seed)[0] for seed in (5, 5, 6))
    assert [reward for _, reward, _ in first] == [reward for _, reward, _ in again]
    assert all(
        np.array_equal(one[0][key], two[0][key]) for one, two in zip(first, again, strict=True) for key in one[0]
    )
    assert [reward for _, reward, _ in first] != [reward for _, reward, _ in other]


def test_an_observation_is_the_graph_that_the_robot_has(env):
    observation, info = env.reset(options={"world": 3})
    graph = env._observation
    count = int(observation["count"])
    assert count == graph.nodes
    edges = observation["edges"][observation["edges"][:, 0] >= 0]
    assert len(edges) == len(graph.neighbours)
    robot = int(observation["robot"])
    beside = {int(b if a == robot else a) for a, b in edges.tolist() if robot in (a, b)}
    assert beside == set(np.flatnonzero(info["action_mask"][1]))
    assert set(np.flatnonzero(info["action_mask"][0])) == set(graph.beacon_nodes().tolist())
    assert np.array_equal(observation["nodes"][robot, :2], [0.0, 0.0])
    assert not observation["nodes"][count:].any()
    # Metres: neighbours are at most sqrt(5) spacings away.
    distances = np.hypot(*observation["nodes"][sorted(beside), :2].T)
    assert distances.max() <= 4.0 * np.sqrt(5) + 1e-3
    again, _ = env.reset(options={"world": 3})
    assert np.array_equal(observation["nodes"], again["nodes"])


def test_a_forbidden_action_moves_nothing_and_costs(env):
    env = PlanningEnv([*SMALL, "task.max_steps=3"], max_viewpoints=128, invalid_cost=2.5)
    before, _ = env.reset(seed=1)
    where = env._stage.environment.pose
    robot = int(before["robot"])
    for number in range(3):
        after, reward, terminated, truncated, info = env.step(np.array([robot, robot]))
        assert reward == -2.5
        assert info["invalid_action"]
        assert np.array_equal(before["nodes"], after["nodes"])
        assert (terminated, truncated) == (False, number == 2)
    assert env._stage.environment.pose == where
    with pytest.raises(HDError, match="call reset"):
        env.step(np.array([robot, robot]))


def test_environments_run_side_by_side():
    make = [lambda: PlanningEnv(SMALL, max_viewpoints=128)] * 2
    vector = gymnasium.vector.SyncVectorEnv(make)
    observations, infos = vector.reset(seed=[1, 2])
    assert observations["nodes"].shape == (2, 129, 6)
    beacons, waypoints = observations["beacon_mask"], observations["waypoint_mask"]
    actions = np.stack([beacons.argmax(axis=1), waypoints.argmax(axis=1)], axis=1)
    _, _, _, _, infos = vector.step(actions)
    assert not infos["invalid_action"].any()
    vector.close()


def test_the_way_is_shown(env):
    assert env.render() is None
    shown = PlanningEnv(SMALL, max_viewpoints=128, render_mode="rgb_array")
    _, info = shown.reset(seed=2)
    first = shown.render()
    assert first.shape == (240, 320, 3)
    shown.step(shown.action_space.sample(info["action_mask"]))
    assert (shown.render() != first).any()


def test_mistakes_are_named(env):
    with pytest.raises(ConfigError, match="did you mean 'task.max_steps'"):
        PlanningEnv(["task.max_step=3"])
    with pytest.raises(ConfigError, match="rgb_array"):
        PlanningEnv(SMALL, render_mode="human")
    with pytest.raises(ConfigError, match="not both"):
        PlanningEnv(SMALL, config=env.config)
    with pytest.raises(ConfigError, match="room for 5 and 48: make the environment with max_viewpoints"):
        PlanningEnv(SMALL, max_viewpoints=4).reset(seed=1)
    with pytest.raises(HDError, match="call reset"):
        PlanningEnv(SMALL).step(np.array([0, 0]))


def test_what_is_no_action_or_world_is_told(env):
    for options in ({"world": -1}, {"world": "a"}, {"world": 1.5}, {"world": True}, {"wrld": 1}):
        with pytest.raises(ConfigError, match="'world': NUMBER"):
            env.reset(options=options)
    env.reset(options={"world": np.int64(1)})
    for action in (None, 3, [1, 2, 3], [np.nan, 1.0], [0.4, 1.0], ["a", "b"]):
        with pytest.raises(ConfigError, match="two whole numbers of nodes"):
            env.step(action)
    assert env.step(np.array([-1.0, 0.0]))[4]["invalid_action"]
    with pytest.raises(ConfigError, match="at least one"):
        PlanningEnv(SMALL, max_viewpoints=-5)
