"""What a robot's profile says of the policy that comes with it."""

import logging

import pytest

from common.tasks import EXPLORATION, NAVIGATION
from deploy.bridge.planner_selector import make_planners
from deploy.profiles import DEPLOY, load_deploy_config


@pytest.mark.parametrize("profile", DEPLOY.preset_names())
@pytest.mark.parametrize("task", [EXPLORATION.name, NAVIGATION.name])
def test_no_profile_warns_of_the_shipped_policy(profile, task, caplog):
    goal = ["decision.goal=5,5"] if task == NAVIGATION.name else []
    config = load_deploy_config(None, [f"decision.task={task}", *goal], {}, profile)
    with caplog.at_level(logging.WARNING):
        planners = make_planners(config)
        planners.begin(config.decision.task, config.decision.goal)
    assert caplog.messages == []
