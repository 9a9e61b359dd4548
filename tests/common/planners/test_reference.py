"""The reference route leads along the robot's own graph to where its planner would go."""

from itertools import pairwise

import numpy as np
import pytest

from actors.environment import Environment
from actors.maps.generators import make_generator
from actors.simulators.grid import GridSimulator
from actors.tasks import make_goal
from common.config import MappingConfig, RewardConfig, SimulatorConfig, TaskConfig
from common.messages.experience import End
from common.planners.reference import ReferenceRoute


@pytest.mark.parametrize("task", ["exploration", "navigation"])
def test_following_the_route_completes_the_task(task: str) -> None:
    mapping = MappingConfig()
    config = TaskConfig(name=task)
    world = make_generator("rooms", {"width": "320", "height": "240"}).world(3, 0.25)
    simulator = GridSimulator(SimulatorConfig(name="grid", rays=360), mapping.sensor_range)
    reference = ReferenceRoute(mapping)
    environment = Environment(simulator, mapping, make_goal(config), RewardConfig(), 128, reference=reference)
    observation = environment.reset(world, 0)
    routes = 0
    while environment.end is End.NONE:
        mapper = environment.mapper
        route = observation.route.astype(int).tolist()
        assert mapper.robot not in route
        places = [mapper.robot, *route]
        if task == "exploration":
            assert route, "there is always something to go to while the task is not complete"
            assert all(mapper.joined(a, b) or a == b for a, b in pairwise(places))
        routes += bool(route)
        choices = observation.waypoint_nodes()
        known_target = observation.target_known and observation.viewpoints in choices
        waypoint = observation.viewpoints if known_target else (route or choices.tolist())[0]
        observation = environment.step(int(observation.beacon_nodes()[0]), int(waypoint)).observation
    assert environment.success
    assert routes > 0


def test_an_observation_without_a_reference_has_no_route() -> None:
    mapping = MappingConfig()
    world = make_generator("rooms", {"width": "320", "height": "240"}).world(3, 0.25)
    simulator = GridSimulator(SimulatorConfig(name="grid", rays=360), mapping.sensor_range)
    environment = Environment(simulator, mapping, make_goal(TaskConfig()), RewardConfig(), 8)
    observation = environment.reset(world, 0)
    assert len(observation.route) == 0
    assert (observation.cell, observation.reach) == (0.0625, 5.0)
    assert np.count_nonzero(observation.utility) > 0
