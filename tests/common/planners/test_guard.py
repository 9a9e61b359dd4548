"""The guard: the shipped policies decide in worlds like those of their training, a classical planner elsewhere."""

from dataclasses import replace

import pytest

from actors.environment import Environment
from actors.maps.generators import make_generator
from actors.simulators.grid import GridSimulator
from actors.tasks import make_goal
from common.config import MappingConfig, RewardConfig, SimulatorConfig, TaskConfig
from common.mapping.mapper import Mapper
from common.messages.experience import End
from common.planners.base import TaskName
from common.planners.learned import LearnedPlanner, bare_planner
from common.planners.registry import make_planner
from common.planners.suited_mapping import of_known_scale
from common.policies.policy_file import read_weights
from common.policies.shipped import shipped_policy
from tests.common.planners.environments import MAPPING, environment_in


@pytest.mark.parametrize(
    ("name", "task", "radius", "classical"),
    [
        ("office", "exploration", 0.0, "tour"),
        ("office", "navigation", 0.0, "dstar_lite"),
        ("office", "navigation", 0.25, "far"),
        ("rooms", "navigation", 0.25, "far"),
        ("forest", "navigation", 0.0, "dstar_lite"),
    ],
)
def test_where_the_policy_is_out_of_its_depth_a_classical_planner_decides(
    name: str, task: TaskName, radius: float, classical: str
) -> None:
    mapping = MappingConfig(robot_radius=radius)
    environment = environment_in(name, 5_000_001, task, mapping)
    learned, planner = LearnedPlanner(mapping), make_planner(classical, mapping)
    for each in (learned, planner):
        each.reset(task, environment.goal.target, 0)
    while environment.end is End.NONE and learned.guarded < 12:
        plan, expected = (each.plan(environment.mapper, environment.pose) for each in (learned, planner))
        assert plan.waypoint is not None
        assert plan.waypoint == expected.waypoint
        assert learned.guarded_by == classical and learned.attention is None
        environment.step_to(plan.waypoint, plan.via)
    assert learned.guarded == environment.steps > 3


@pytest.mark.parametrize(("radius", "name"), [(0.0, "dstar_lite"), (0.25, "far")])
def test_one_classical_planner_decides_wherever_it_is_asked_for_and_knows_what_it_planned(
    radius: float, name: str
) -> None:
    learned = LearnedPlanner(MappingConfig(robot_radius=radius))
    learned.reset("navigation", (30.0, 0.0), 0)
    assert [deputy.name for deputy in learned.deputies] == [name]


def waypoints(planner: LearnedPlanner, mapper: Mapper, environment: Environment) -> list[object]:
    planner.reset("exploration", None, 0)
    return [planner.plan(mapper, environment.pose).waypoint]


@pytest.mark.parametrize("name", ["rooms", "forest"])
def test_within_its_depth_the_shipped_policy_decides(name: str) -> None:
    environment = environment_in(name, 5_000_000)
    learned, bare = LearnedPlanner(MAPPING), bare_planner(MAPPING)
    own = LearnedPlanner(MAPPING, policy=shipped_policy("exploration"))
    chosen = [waypoints(planner, environment.mapper, environment) for planner in (learned, bare, own)]
    assert chosen[0] == chosen[1] == chosen[2]
    assert learned.guarded == 0 and learned.attention is not None


def test_a_policy_of_ones_own_has_no_guard() -> None:
    environment = environment_in("office", 5_000_001)
    own = LearnedPlanner(MAPPING, policy=shipped_policy("exploration"))
    own.reset("exploration", None, 0)
    own.plan(environment.mapper, environment.pose)
    assert own.guarded == 0 and own.attention is not None


@pytest.mark.parametrize(
    ("changes", "within"),
    [
        ({"sensor_range": 15.0, "viewpoint_spacing": 3.0}, True),
        ({"sensor_range": 30.0}, True),
        ({"sensor_range": 30.0, "viewpoint_spacing": 3.0}, False),
        ({"robot_radius": 0.25}, True),
        ({"resolution": 0.1}, False),
        ({"viewpoint_spacing": 1.0}, False),
        ({"sensor_range": 10.0}, False),
        ({"sensor_range": 10.0, "viewpoint_spacing": 2.0}, False),
    ],
)
def test_cells_and_spacing_of_another_scale_are_no_place_for_a_shipped_policy(
    changes: dict[str, float], within: bool
) -> None:
    mapping = MappingConfig(**{**MAPPING.model_dump(), **changes})
    learned = LearnedPlanner(mapping)
    simulator = GridSimulator(SimulatorConfig(name="grid", rays=360), mapping.sensor_range)
    fitting = learned.mapping_for("exploration")
    environment = Environment(simulator, fitting, make_goal(TaskConfig(name="exploration")), RewardConfig(), 200)
    environment.reset(make_generator("rooms", {}).world(5_000_000, 0.25), 0, on_lattice=False)
    learned.reset("exploration", None, 0)
    for _ in range(8):
        plan = learned.plan(environment.mapper, environment.pose)
        assert plan.waypoint is not None
        environment.step_to(plan.waypoint, plan.via)
    assert (learned.attention is not None) == within
    # The classical planner that decides alone gets the mapping that was asked for, and so drives as by itself.
    assert within or fitting == mapping


def test_a_policy_of_one_range_has_the_same_room_whether_its_card_names_the_range_or_not() -> None:
    """Cards of later trainings name the ranges that were drawn."""
    _, card = read_weights(shipped_policy("exploration"))
    named = replace(card, ranges={"sensor_range": (20.0, 20.0)})
    for sensor, within in ((15.0, True), (10.0, False)):
        mapping = MappingConfig(sensor_range=sensor, viewpoint_spacing=sensor / 5.0)
        assert of_known_scale(card, mapping) is of_known_scale(named, mapping) is within
