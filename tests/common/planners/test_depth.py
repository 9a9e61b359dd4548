"""Worlds like those of the shipped policies' training are told from others."""

import pytest

from common.config import MappingConfig
from common.messages.experience import End
from common.planners.depth import MOST_CYCLES, Decider, Depth
from common.planners.registry import make_planner
from tests.common.planners.environments import MAPPING, environment_in


@pytest.mark.parametrize(
    ("name", "explores", "decider"),
    [
        ("rooms", True, Decider.POLICY),
        ("forest", True, Decider.POLICY),
        ("forest", False, Decider.IN_THE_OPEN),
        ("office", True, Decider.REFERENCE),
        ("warehouse", True, Decider.REFERENCE),
        ("tunnel", True, Decider.REFERENCE),
    ],
)
def test_worlds_are_told_apart_early(name: str, explores: bool, decider: Decider) -> None:
    for number in (5_000_000 + k for k in range(3)):
        environment = environment_in(name, number)
        planner = make_planner("nearest", MAPPING)
        depth = Depth(MAPPING, explores=explores)
        judged = depth.decider(environment.mapper, 0)
        while environment.end is End.NONE and environment.mapper.explored_area < 260.0:
            plan = planner.plan(environment.mapper, environment.pose)
            assert plan.waypoint is not None
            environment.step_to(plan.waypoint, plan.via)
            judged = depth.decider(environment.mapper, 0)
        assert judged is decider, number
        # Once and for all.
        assert depth.decider(environment_in("rooms", number).mapper, 0) is decider


def test_halls_are_no_forests() -> None:
    """They are as open, but `greedy` drives a quarter farther there than `tour`."""
    for number in (5_000_000 + k for k in range(8)):
        environment = environment_in("hall", number)
        judged = Depth(MAPPING).decider(environment.mapper, MOST_CYCLES + 1)
        assert environment.mapper.explored_area < 250.0 or judged is Decider.REFERENCE, number


@pytest.mark.parametrize("spacing", [4.0, 6.0])
@pytest.mark.parametrize(("name", "decider"), [("rooms", Decider.POLICY), ("office", Decider.REFERENCE)])
def test_with_a_longer_sensor_the_policy_decides_where_walls_alone_divide_the_floor(
    name: str, decider: Decider, spacing: float
) -> None:
    mapping = MappingConfig(sensor_range=30.0, viewpoint_spacing=spacing)
    environment = environment_in(name, 5_000_000, mapping=mapping, rays=720)
    planner, depth = make_planner("nearest", mapping), Depth(mapping, trained=MAPPING)
    while depth.decider(environment.mapper, 0) is Decider.REFERENCE and environment.mapper.explored_area < 600.0:
        plan = planner.plan(environment.mapper, environment.pose)
        assert plan.waypoint is not None
        environment.step_to(plan.waypoint, plan.via)
    assert depth.decider(environment.mapper, 0) is decider


@pytest.mark.parametrize(("name", "decider"), [("rooms", Decider.REFERENCE), ("forest", Decider.IN_THE_OPEN)])
def test_a_policy_that_dithers_is_out_of_its_depth(name: str, decider: Decider) -> None:
    mapper = environment_in(name, 5_000_000).mapper
    depth = Depth(MAPPING)
    assert depth.decider(mapper, MOST_CYCLES) is Decider.POLICY
    assert depth.decider(mapper, MOST_CYCLES + 1) is decider
    assert depth.decider(mapper, 0) is decider
