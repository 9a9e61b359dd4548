"""Planners on random places pass the doors that the robot fits through, where chance would leave rooms out."""

import pytest

from common.config import MappingConfig
from common.planners.registry import make_planner
from tests.common.planners.rollout import explore
from tests.plans import Plan, crawlway, office_floor


@pytest.mark.parametrize("name", ["dsvp", "nbvp"])
@pytest.mark.parametrize("plan", [office_floor(), crawlway()], ids=lambda plan: plan.world.name)
def test_a_robot_with_a_size_sees_every_room_behind_a_door(name: str, plan: Plan) -> None:
    config = MappingConfig(resolution=0.1, robot_radius=0.25)
    episode = explore(make_planner(name, config), plan.world, config, max_steps=200, unseen_area=1.0)
    assert episode.complete, episode.reason
