"""What DSVP does with robots as they are."""

from __future__ import annotations

import math

from actors.maps.generators import make_generator
from common.config import MappingConfig
from common.planners.registry import make_planner
from tests.common.planners.rollout import explore


def test_a_robot_that_stops_beside_a_place_is_not_sent_onto_it_for_ever() -> None:
    world = make_generator("office", {"width": "320", "height": "240"}).world(2)
    config = MappingConfig()
    episode = explore(make_planner("dsvp", config), world, config, slack=0.05, max_steps=120, unseen_area=0.0)
    legs = [
        math.dist(plan.waypoint, at)
        for plan, at in zip(episode.plans, episode.waypoints, strict=False)
        if plan.waypoint is not None
    ]
    assert len(legs) > 80
    assert min(legs) > 0.3
