import numpy as np
import pytest

from actors.evaluation.large.tour import LEG_SHARE, ROOM, leg_world, tour_targets
from actors.maps.generators import make_generator
from actors.simulators.clearance import clearance
from common.errors import MapError


def test_targets_have_room_are_far_apart_and_repeat_by_seed():
    world = make_generator("building", {}).world(1)
    tour = tour_targets(world, 5, seed=9)
    assert tour == tour_targets(world, 5, seed=9) != tour_targets(world, 5, seed=10)
    shortest = LEG_SHARE * np.hypot(*world.size)
    here = world.start
    for target in tour:
        assert clearance(world, target, ROOM) >= ROOM
        assert np.hypot(*np.subtract(here, target)) >= shortest
        leg = leg_world(world, here, target)
        assert (leg.start, leg.target) == (here, target)
        assert leg.target_region is not None and leg.target_region[leg.cell(target)]
        assert leg.free is world.free
        here = target


def test_a_world_without_so_many_places_is_refused():
    world = make_generator("building", {"width": "192", "height": "192"}).world(0)
    with pytest.raises(MapError, match="fewer targets"):
        tour_targets(world, 500, seed=0)
