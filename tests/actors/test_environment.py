import dataclasses

import numpy as np
import pytest

from actors.driver import ExpertDriver, RandomDriver
from actors.environment import Environment
from actors.episode import Role, run_episode
from actors.expert import make_expert
from actors.simulators.grid import GridSimulator
from actors.tasks import make_goal
from common.config import MappingConfig, RewardConfig, SimulatorConfig, TaskConfig
from common.errors import ConfigError, HDError, MapError
from common.messages.experience import End
from tests.actors.worlds import draw

MAPPING = MappingConfig(resolution=0.5, sensor_range=8.0, viewpoint_spacing=2.0, beacon_range=8.0)
ROLE = Role("train", "grid")

CORRIDOR = draw("#" * 34, "#S" + "." * 31 + "#", "#" * 34, lattice=(1.5, 1.5))
ROOM = draw("######", "#....#", "#.S..#", "#....#", "######", lattice=(0.5, 0.5))
SEALED = draw("############", "#S....#..T.#", "#.....#....#", "############", lattice=(1.5, 1.5))
HALLWAY = draw("#" * 26, "#S" + "." * 21 + "T.#", "#" * 26, lattice=(1.5, 1.5))
BRANCHES = draw(
    "####################",
    "#S.......#.........#",
    "#........#.........#",
    "#........#.........#",
    "####.#########.#####",
    "#..................#",
    "#..................#",
    "####.#########.#####",
    "#.......#..........#",
    "#.......#.........T#",
    "####################",
    lattice=(0.5, 0.5),
)


def route_length(positions):
    return float(np.hypot(*np.diff(np.array(positions), axis=0).T).sum())


def environment(
    world_task="exploration",
    *,
    max_steps=64,
    reward=None,
    expert=True,
    simulator=None,
    mapping=MAPPING,
    replans=False,
    **task,
):
    config = TaskConfig(name=world_task, max_steps=max_steps, **{"unseen_area": 1.0, **task})
    return Environment(
        simulator or GridSimulator(SimulatorConfig(name="grid", rays=720), mapping.sensor_range),
        mapping,
        make_goal(config),
        reward or RewardConfig(),
        max_steps,
        make_expert(config, mapping) if expert else None,
        replans=replans,
    )


def test_one_room_is_complete_before_the_first_decision():
    env = environment()
    report = run_episode(env, ROOM, ExpertDriver(), ROLE, seed=0)
    assert env.end is End.TERMINAL
    assert env.reason == "complete"
    assert report.success
    assert report.steps == 0
    assert report.explored == 1.0


def test_a_corridor_is_explored_straight_to_its_end():
    env = environment()
    report = run_episode(env, CORRIDOR, ExpertDriver(), ROLE, seed=0)
    assert report.success
    # 32 m long, sensed 8 m ahead, 1 m2 may stay unseen: at least 32 - 0.5 - 8 - 1 m of travel, on a 2 m lattice.
    assert 22.0 <= report.distance <= 24.0
    assert report.distance == pytest.approx(2.0 * np.ceil((32 - 0.5 - 8 - 1) / 2))
    assert env.positions[0] == CORRIDOR.start
    assert route_length(env.positions) == pytest.approx(report.distance)
    assert report.explored >= 31 / 32


def test_the_step_limit_truncates():
    env = environment(max_steps=3)
    report = run_episode(env, CORRIDOR, RandomDriver(np.random.default_rng(0)), ROLE, seed=0)
    assert env.end is End.TRUNCATED
    assert env.reason == "step limit"
    assert report.steps == 3
    assert not report.success


def test_navigation_arrives():
    env = environment("navigation", arrival_radius=1.0)
    report = run_episode(env, HALLWAY, ExpertDriver(), ROLE, seed=0)
    assert report.success
    assert env.pose.distance_to(HALLWAY.target) <= 1.0
    assert 21.0 <= report.distance <= 22.0


def test_a_target_in_sight_can_be_driven_to_directly():
    env = environment("navigation", arrival_radius=0.1)
    run_episode(env, HALLWAY, ExpertDriver(), ROLE, seed=0)
    assert env.success
    assert env.positions[-1] == pytest.approx(HALLWAY.target)


def test_a_target_at_the_start_is_reached_without_a_decision():
    world = dataclasses.replace(HALLWAY, target=(2.0, 1.5))
    env = environment("navigation", arrival_radius=1.0)
    env.reset(world, seed=0)
    assert env.success
    assert env.steps == 0


def test_an_unreachable_target_is_a_terminal_failure():
    env = environment("navigation", expert=False)
    report = run_episode(env, SEALED, RandomDriver(np.random.default_rng(0)), ROLE, seed=0)
    assert env.end is End.TERMINAL
    assert env.reason == "target unreachable"
    assert not report.success


def test_nothing_useful_left_is_a_terminal_failure():
    # A niche that no viewpoint of the lattice looks into: 3 m2 stay unseen, and none of it can be observed.
    world = draw("##########", "#S.......#", "#........#", "######.###", "######.###", "######..##", "#######.##",
                 "##########", lattice=(0.5, 0.5))  # fmt: skip
    env = environment(unseen_area=0.0)
    report = run_episode(env, world, RandomDriver(np.random.default_rng(1)), ROLE, seed=0)
    assert env.end is not End.NONE
    if env.end is End.TERMINAL and not report.success:
        assert env.reason == "nothing useful left"


def test_a_start_beside_the_lattice_drives_to_its_viewpoint_first():
    world = dataclasses.replace(CORRIDOR, start=(2.2, 1.5))
    env = environment()
    observation = env.reset(world, seed=0)
    assert env.steps == 0
    assert env.distance == pytest.approx(0.7)
    assert env.positions == [(2.2, 1.5), pytest.approx((1.5, 1.5))]
    assert env.mapper.position(observation.robot) == pytest.approx((1.5, 1.5))


def test_a_start_far_from_every_lattice_point_has_a_viewpoint_of_its_own():
    env = environment()
    env.reset(draw("####", "#S.#", "####", lattice=(10.0, 10.0)), seed=0)
    assert len(env.mapper.viewpoints) == 1
    assert env.success


def test_a_start_where_the_robot_does_not_fit_is_an_error():
    world = draw("####", "#S.#", "####", lattice=(10.0, 10.0))
    env = environment(mapping=MAPPING.model_copy(update={"robot_radius": 0.6}))
    with pytest.raises(MapError, match="does not fit"):
        env.reset(world, seed=0)


class ClosingDoor(GridSimulator):
    """The grid simulator of a world whose door falls shut at the robot's first drive through it."""

    def __init__(self, closed):
        super().__init__(SimulatorConfig(name="grid", rays=720), MAPPING.sensor_range)
        self.closed = closed

    def drive_to(self, waypoint):
        self._world = self.closed
        return super().drive_to(waypoint)


def test_a_blocked_leg_is_survived_and_counts_as_blocked():
    door = "#......S.........#"
    shut = "#......S.#.......#"
    simulator = ClosingDoor(draw("#" * 18, shut, "#" * 18, lattice=(1.5, 1.5)))
    env = environment(simulator=simulator, expert=False, max_steps=40)
    observation = env.reset(draw("#" * 18, door, "#" * 18, lattice=(1.5, 1.5)), seed=0)
    blocked = 0
    while env.end is End.NONE:
        choices = observation.waypoint_nodes()
        east = max(choices, key=lambda node: observation.offsets[node, 0])
        step = env.step(int(observation.beacon_nodes()[-1]), int(east))
        blocked += step.info.blocked
        observation = step.observation
    assert blocked >= 1
    assert env.reason != "complete"
    assert not env.success
    # The wall that appeared is known now, and the robot stands before it, on a viewpoint.
    assert env.mapper.belief.at((9.25, 1.5)) == 100
    assert env.pose.x < 9.0
    assert env.steps <= 40
    assert route_length(env.positions) == pytest.approx(env.distance)


def test_rewards_of_an_episode_add_up():
    env = environment()
    report = run_episode(env, CORRIDOR, ExpertDriver(), ROLE, seed=0)
    assert report.reward == pytest.approx(env.total_reward)
    # Finish bonus, less the distance, plus a few frontier cells.
    assert 20.0 - report.distance / 16 <= report.reward <= 20.0


def test_the_potential_reward_of_the_expert_is_nearly_nothing():
    env = environment(reward=RewardConfig(kind="potential"))
    report = run_episode(env, BRANCHES, ExpertDriver(), ROLE, seed=0)
    assert report.success
    assert abs(report.reward) < 2.0
    other = environment(reward=RewardConfig(kind="potential"))
    wandering = run_episode(other, BRANCHES, RandomDriver(np.random.default_rng(3)), ROLE, seed=0)
    assert wandering.reward < report.reward - 1.0


def test_the_potential_reward_needs_an_expert():
    with pytest.raises(ConfigError, match="expert"):
        environment(reward=RewardConfig(kind="potential"), expert=False)


def test_invalid_choices_are_refused():
    env = environment()
    with pytest.raises(HDError, match="reset"):
        env.step(0, 0)
    observation = env.reset(CORRIDOR, seed=0)
    beacon = int(observation.beacon_nodes()[0])
    with pytest.raises(HDError, match="waypoint"):
        env.step(beacon, observation.robot)
    useless = next(node for node in range(observation.viewpoints) if node not in observation.beacon_nodes())
    with pytest.raises(HDError, match="beacon"):
        env.step(useless, int(observation.waypoint_nodes()[0]))


def test_navigation_needs_a_world_with_a_target():
    with pytest.raises(MapError, match="no target"):
        environment("navigation").reset(CORRIDOR, seed=0)


@pytest.mark.parametrize("task", ["exploration", "navigation"])
def test_episodes_repeat_exactly(task):
    def play():
        env = environment(task, max_steps=30)
        report = run_episode(env, BRANCHES, RandomDriver(np.random.default_rng(5)), ROLE, seed=1)
        return dataclasses.replace(report, duration=0.0), env.positions

    assert play() == play()


def test_free_positions_are_driven_to_under_the_rules():
    env = environment()
    env.reset(dataclasses.replace(CORRIDOR, start=(2.2, 1.5)), seed=0, on_lattice=False)
    # No drive to a viewpoint before the first decision.
    assert env.positions == [(2.2, 1.5)]
    step = env.step_to((5.0, 1.2))
    assert env.positions[-1] == (5.0, 1.2)
    assert step.distance == pytest.approx(np.hypot(2.8, 0.3))
    assert env.steps == 1
    assert env.mapping_seconds > 0.0
    with pytest.raises(HDError, match="one edge"):
        env.step_to((10.0, 1.5))
    with pytest.raises(HDError, match="not known to be free"):
        env.step_to((5.0, 3.5))
    with pytest.raises(HDError, match="finite"):
        env.step_to((float("nan"), 1.5))
    assert env.steps == 1
    while env.end is End.NONE:
        step = env.step_to((env.pose.x + 4.0, 1.2))
    assert env.success
    with pytest.raises(HDError, match="ended"):
        env.step_to(env.pose.position)


def test_free_planners_end_by_themselves_or_at_the_step_limit():
    env = environment("navigation", max_steps=3)
    env.reset(SEALED, seed=0, on_lattice=False)
    for _ in range(3):
        assert env.end is End.NONE
        env.step_to(env.pose.position)
    assert (env.end, env.reason) == (End.TRUNCATED, "step limit")


@pytest.mark.parametrize("replans", [False, True])
def test_a_robot_that_replans_stops_where_nothing_is_left_to_see_from_its_goal(replans):
    """The end of the corridor is in range long before the robot is at the goal that looks at it."""
    env = environment(
        simulator=GridSimulator(SimulatorConfig(name="grid", rays=720, sense_every=0.25), MAPPING.sensor_range),
        expert=False,
        unseen_area=0.0,
        replans=replans,
    )
    env.reset(CORRIDOR, seed=0, on_lattice=False)
    short = 0
    while env.end is End.NONE:
        mapper = env.mapper
        useful = np.flatnonzero(mapper.observe().utility)
        goal = mapper.position(int(useful[np.argmin(mapper.viewpoints[useful, 0])]))
        waypoint = (env.pose.x + 4.0, 1.5)
        env.step_to(waypoint, goal=goal)
        short += env.pose.position != waypoint
    assert env.success
    assert (short > 0) == replans
    assert env.distance == pytest.approx(env.pose.x - CORRIDOR.start[0])
