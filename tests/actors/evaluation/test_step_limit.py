import numpy as np
import pytest

from actors.evaluation.step_limit import looks, needed_steps, step_limit, warn_of_limit
from actors.maps.layout import build_map
from actors.maps.sources import open_sources
from common.config import MappingConfig


def room(width, height, inside=()):
    """A room of so many metres, with walls (left, bottom, right, top) in it."""
    free = np.zeros((4 * height + 8, 4 * width + 8), dtype=np.bool_)
    free[4:-4, 4:-4] = True
    for left, bottom, right, top in inside:
        free[4 + round(4 * bottom) : 4 + round(4 * top), 4 + round(4 * left) : 4 + round(4 * right)] = False
    return build_map("room", free, 0.25, (6, 6), None)


def test_an_open_room_takes_one_look():
    assert looks(room(10, 8), 20.0) == pytest.approx(1.0, rel=0.05)


def test_ten_rooms_take_about_ten_looks():
    walls = [(4.0 * k - 0.25, 0.5, 4.0 * k, 8.0) for k in range(1, 10)]
    assert 7.0 < looks(room(40, 8, walls), 20.0) < 12.0


def test_open_space_takes_more_looks_for_a_shorter_sight():
    hall = room(100, 60)
    assert looks(hall, 20.0) == pytest.approx(6000 / (np.pi * 400), rel=0.5)
    assert 3.0 < looks(hall, 10.0) / looks(hall, 20.0) < 4.2


def test_space_that_cannot_be_reached_does_not_count():
    assert looks(room(30, 8, [(10.0, 0.0, 10.5, 8.0)]), 20.0) == pytest.approx(1.0, rel=0.1)


def test_closer_viewpoints_take_more_steps():
    world = room(60, 40)
    coarse, fine = (needed_steps(world, MappingConfig(viewpoint_spacing=spacing)) for spacing in (4.0, 1.0))
    assert 3.8 < fine / coarse < 4.2


def test_public_like_maps_keep_their_limit_and_offices_get_a_larger_one():
    mapping = MappingConfig()
    rooms, office = (open_sources([f"generator:{kind}"], None, "exploration").world(0) for kind in ("rooms", "office"))
    assert warn_of_limit([rooms], 128, mapping) == ""
    told = warn_of_limit([rooms, office], 128, mapping)
    assert told.startswith("128 decisions are likely to be too few for 1 of 2 worlds looked at: office-0, ")
    assert f"takes about {needed_steps(office, mapping)}; raise the limit with --set task.max_steps=" in told
    limit = step_limit([rooms, office], mapping)
    assert limit % 50 == 0 and limit >= 2 * needed_steps(office, mapping) - 1 > 256
    assert step_limit([room(10, 8)], mapping) == 128
    assert step_limit([room(60, 40)], MappingConfig(resolution=0.01, viewpoint_spacing=0.02)) == 10_000
