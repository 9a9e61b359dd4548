import dataclasses
import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from rich.console import Console

pytest.importorskip("PIL", reason="Pillow is not installed")

from actors.evaluation.plots import FREE, OCCUPIED, UNKNOWN
from actors.maps.grid_map import GridMap
from common import palette
from common.geometry import Pose
from deploy.robot import film
from deploy.robot.film import HOLD_LAST, STRIP, PackedGrid, Shot, frames
from deploy.robot.simulation import Grid
from deploy.robot.terminal import live_view, picture
from tests.plans import office_floor


def hall():
    """A hall of 8 m x 6 m with walls of 1 m and 2 m of rock around it, its origin in the middle."""
    free = np.zeros((40, 48), dtype=np.bool_)
    free[12:-12, 12:-12] = True
    return GridMap("hall", free, 0.25, (-6.0, -5.0), (0.0, 0.0), None, None, (0.0, 0.0))


def half_known():
    """Left of x = 0 everything is known, in cells of 0.2 m that are not aligned with the map's."""
    cells = np.full((40, 60), -1, dtype=np.int8)
    grid = Grid(cells, 0.2, (-5.9, -3.9))
    x = grid.origin[0] + 0.2 * (np.arange(60) + 0.5)
    y = grid.origin[1] + 0.2 * (np.arange(40) + 0.5)
    inside = (abs(x)[None, :] < 3.0) & (abs(y)[:, None] < 2.0)
    left = np.broadcast_to(x[None, :] < 0.0, cells.shape)
    cells[inside & left] = 0
    cells[~inside & left & (x[None, :] > -3.4)] = 100
    return grid


def shot(time=1.0, belief=None, words="greedy"):
    packed = None if belief is None else PackedGrid.of(belief)
    return Shot(time, Pose(-1.0, 0.0, 0.5), packed, ((1.0, 1.0), (2.0, 0.0)), (2.0, 1.0), words)


def test_a_film_shows_what_is_known_and_holds_its_last_picture():
    pictures = list(frames([shot(), shot(2.0, half_known())], hall(), target=(2.5, 1.5), width=320))
    assert len(pictures) == 2 + HOLD_LAST
    assert {each.size for each in pictures} == {(320, 228 + STRIP)}
    before, after = np.asarray(pictures[0]), np.asarray(pictures[-1])
    # (x, y) in pixels of the picture: 45.7 per metre, from the upper left corner at (-3.5, 2.5).
    known, unknown, wall = (69, 182 + STRIP), (251, 182 + STRIP), (11, 114 + STRIP)
    assert tuple(before[known[1], known[0]]) == UNKNOWN
    assert tuple(after[known[1], known[0]]) == FREE
    assert tuple(after[unknown[1], unknown[0]]) == UNKNOWN
    assert tuple(after[wall[1], wall[0]]) == OCCUPIED


def test_the_terminals_picture_fits_and_shows_robot_and_waypoint():
    text = picture(half_known(), Pose(-1.0, 0.0), [(-2.0, 0.0)], (-1.0, 1.0), columns=20)
    lines = text.plain.splitlines()
    assert len(lines) > 3
    assert all(0 < len(line) <= 20 for line in lines)
    styles = " ".join(str(span.style) for span in text.spans)
    assert palette.ROBOT.dark in styles
    assert palette.WAYPOINT.dark in styles


def test_the_live_view_waits_for_the_first_map():
    out = Console(file=io.StringIO(), width=80)
    out.print(live_view(None, Pose(0.0, 0.0), [], None, {"state": "running: going"}, 40))
    assert "waiting for the first map" in out.file.getvalue()
    assert "running: going" in out.file.getvalue()


def test_a_belief_without_anything_known_can_be_drawn():
    nothing = Grid(np.full((3, 3), -1, dtype=np.int8), 0.2, (0.0, 0.0))
    assert picture(nothing, Pose(0.0, 0.0), [], None, 10).plain.strip()


def test_a_wide_world_has_wide_pictures():
    wide = dataclasses.replace(hall(), free=np.ones((8, 400), dtype=np.bool_))
    small, large, huge = (
        next(frames([shot()], dataclasses.replace(wide, resolution=resolution))).size[0]
        for resolution in (0.1, 0.2, 0.5)
    )
    assert (small, large, huge) == (640, 960, 1280)


@given(cells=arrays(np.int8, array_shapes(min_dims=2, max_dims=2), elements=st.sampled_from([-1, 0, 100])))
def test_a_packed_grid_is_the_grid(cells):
    found = PackedGrid.of(Grid(cells, 0.2, (-1.0, 3.5))).grid()
    assert np.array_equal(found.cells, cells)
    assert (found.resolution, found.origin) == (0.2, (-1.0, 3.5))


def test_thousands_of_beliefs_of_a_floor_fit_in_memory():
    world = office_floor().world
    grid = Grid(np.where(world.free, 0, 100).astype(np.int8), world.resolution, world.origin)
    assert len(PackedGrid.of(grid).packed) < grid.cells.nbytes / 20


def test_a_long_deployment_makes_a_video_of_bounded_length_that_ends_at_its_end(monkeypatch):
    monkeypatch.setattr(film, "MOST_PICTURES", 4)
    shots = [shot(float(number), words=str(number)) for number in range(9)]
    pictures = list(frames(shots, hall(), width=320))
    assert len(pictures) == 4 + HOLD_LAST
    (last,) = list(frames(shots[-1:], hall(), width=320))[:1]
    strips = [np.asarray(each)[:STRIP] for each in (pictures[3], last)]
    assert np.array_equal(*strips)
