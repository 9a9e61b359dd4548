"""The facts that the hand-made plans claim, by a slow and obvious count."""

import numpy as np
import pytest

from actors.maps.connectivity import reachable
from common.mapping.raycast import cast_rays
from tests.plans import RADIUS, SPACING, all_plans, clear_cells, diagonal_corridor, office_floor, two_rooms

PLANS = all_plans()


@pytest.mark.parametrize("plan", PLANS, ids=lambda plan: plan.world.name)
def test_rooms_are_reachable_as_claimed(plan):
    world = plan.world
    for mask, names in (
        (clear_cells(world.free, RADIUS), plan.reachable),
        (world.free, plan.free_reachable),
    ):
        region = reachable(mask, world.cell(world.start))
        assert {name for name, place in plan.rooms.items() if region[world.cell(place)]} == names
    assert all(world.is_free(place) for place in plan.rooms.values())
    assert not (world.free[0].any() or world.free[-1].any() or world.free[:, 0].any() or world.free[:, -1].any())


def test_a_wider_robot_does_not_pass_the_narrowest_door():
    plan = office_floor()
    region = reachable(clear_cells(plan.world.free, 0.41), plan.world.cell(plan.world.start))
    assert not region[plan.world.cell(plan.rooms["north west"])]
    assert region[plan.world.cell(plan.rooms["north"])]


def test_the_diagonal_corridor_holds_no_point_of_the_lattice():
    world = diagonal_corridor().world
    lattice = np.array([(i, j) for i in range(9) for j in range(9)]) * SPACING + world.lattice_origin
    inside = [point for point in lattice if world.is_free(tuple(point))]
    assert inside and all(max(point) < 8.5 or min(point) > 27.5 for point in inside)


def test_the_alcove_of_the_two_rooms_is_seen_from_beyond_the_door_alone():
    plan = two_rooms()
    world, (x, y) = plan.world, plan.rooms["alcove"]
    angles = np.linspace(-np.pi, np.pi, 3600)
    ranges = cast_rays(world.free, world.resolution, *world.origin, x, y, angles, 20.0)
    assert (x + ranges * np.cos(angles) > 4.4).all()
