import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from common.errors import MessageError
from common.page.tiles import MAX_TILES, SIDE, TileGrid, encode_tile
from tests.common.page.reader import Grid

NAME = "robot/belief"


def taken(grid, frame):
    assert frame[:2] == bytes([1, len(NAME)])
    grid.take(frame[2 + len(NAME) :])


@settings(max_examples=25)
@given(arrays.arrays(np.uint8, (SIDE, SIDE), elements=st.integers(0, 2)), st.integers(0, 2))
def test_a_tile_comes_back_as_it_was_and_has_a_bounded_size(noise, fill):
    for cells in (noise, np.full_like(noise, fill)):
        runs = np.frombuffer(encode_tile(cells), np.uint8)
        assert SIDE <= len(runs) <= cells.size
        assert np.array_equal(np.repeat(runs >> 6, (runs & 63).astype(int) + 1).reshape(SIDE, SIDE), cells)


@settings(max_examples=40)
@given(st.data())
def test_whoever_takes_only_some_frames_has_the_newest_grid(data):
    """A grid that grows to all sides and changes: two readers, one of every frame and one that skips most of them."""
    resolution, anchor = 0.2, (-1.3, 7.1)
    sent, readers, cursors = TileGrid(NAME), [Grid(), Grid()], [0, 0]
    for step in range(data.draw(st.integers(1, 5))):
        left, low = data.draw(st.integers(-90, 90)), data.draw(st.integers(-90, 90))
        shape = data.draw(st.integers(1, 150)), data.draw(st.integers(1, 150))
        seed = data.draw(st.integers(0, 1 << 16))
        cells = np.random.default_rng(seed).choice(np.array([-1, 0, 100], np.int8), shape)
        if step and data.draw(st.booleans()):
            # The robot drove somewhere with another map.
            anchor = anchor[0] + 0.07, anchor[1]
        origin = anchor[0] + left * resolution, anchor[1] + low * resolution
        sent.update(cells, resolution, origin)
        for number in range(2):
            if number == 0 or data.draw(st.booleans()):
                taken(readers[number], sent.since(cursors[number]))
                cursors[number] = sent.revision
    for reader, cursor in zip(readers, cursors, strict=True):
        if cursor != sent.revision:
            taken(reader, sent.since(cursor))
        assert np.array_equal(reader.cells(cells.shape, origin), cells)
        known = sum(int((tile >= 0).sum()) for tile in reader.tiles.values())
        assert known == int((cells >= 0).sum()), "nothing is left of earlier grids"


def test_only_what_changed_is_sent():
    grid = TileGrid(NAME)
    cells = np.full((640, 640), -1, np.int8)
    cells[100:200, 100:200] = 0
    assert grid.update(cells, 0.2, (0.0, 0.0))
    first = grid.revision
    assert not grid.update(cells, 0.2, (0.0, 0.0))
    assert grid.revision == first
    cells[150, 150] = 100
    assert grid.update(cells, 0.2, (0.0, 0.0))
    reader = Grid()
    taken(reader, grid.since(first))
    assert list(reader.tiles) == [(2, 2)]
    assert len(grid.since(first)) < 300


def test_a_grid_that_moves_with_its_robot_costs_what_is_known_now():
    grid, quick, slow = TileGrid(NAME), Grid(), Grid()
    cells = np.zeros((SIDE, SIDE), np.int8)
    cursor = 0
    for step in range(400):
        grid.update(cells, 0.2, (step * SIDE * 0.2, 0.0))
        taken(quick, grid.since(cursor))
        cursor = grid.revision
        if step == 200:
            taken(slow, grid.since(0))
            behind = grid.revision
    assert len(grid.since(0)) < 200, "one tile of equal cells"
    # However many places were left since a browser took its last frame.
    assert len(grid.since(behind)) < 64 * 200
    taken(slow, grid.since(behind))
    for reader in (quick, slow):
        assert [place for place, tile in reader.tiles.items() if (tile >= 0).any()] == [(0, 399)]


def test_a_grid_beyond_all_bounds_is_refused():
    side = SIDE * (int(MAX_TILES**0.5) + 1)
    with pytest.raises(MessageError, match="at most"):
        TileGrid(NAME).update(np.zeros((side, side), np.int8), 0.2, (0.0, 0.0))
