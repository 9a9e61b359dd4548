import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from actors.maps.__main__ import app
from actors.maps.connectivity import label_regions
from actors.maps.image_map import load_image
from actors.maps.layout import build_map
from actors.maps.paths import shortest_distance
from actors.maps.sources import fixed_set, open_sources
from actors.maps.statistics import distance, euler_characteristic, measure, measure_all, open_by_square

PUBLIC = Path(__file__).parents[4] / "shared" / "data" / "maps"


def world_of(picture: str, start: tuple[int, int], target: tuple[int, int]):
    """A map of 16 px blocks: '#' is free; start and target are (column, row from the top)."""
    blocks = np.array([[mark == "#" for mark in line] for line in picture.split()])[::-1]
    spots = [(16 * column + 8, 16 * (len(blocks) - row) - 8) for column, row in (start, target)]
    return build_map("a", blocks.repeat(16, axis=0).repeat(16, axis=1), 0.25, *spots)


RING = """
.................
.####.......####.
.##############..
.##############..
.####.......####.
..##.........##..
..#############..
..#############..
.................
"""


def test_two_rooms_and_a_ring() -> None:
    measured = measure(world_of(RING, (1, 1), (14, 1)))
    # Rooms are what a 3 x 3 square fits into, so the second one loses its outer column.
    assert measured.free_blocks == sum(RING.count(mark) for mark in "#")
    assert measured.rooms == 2
    assert measured.loops == 1
    assert measured.dead_ends == 0
    assert (measured.extent_x, measured.extent_y) == (15, 7)
    assert 0.4 < measured.corridor_share < 0.7
    assert 13 < measured.target_distance < 15


def test_a_room_at_the_end_of_a_corridor_is_a_dead_end() -> None:
    measured = measure(
        world_of("........... .####..###. .#########. .#########. .####..###. ...........", (1, 1), (9, 1))
    )
    assert (measured.rooms, measured.loops, measured.dead_ends) == (2, 0, 2)


masks = st.integers(0, 2**32).map(lambda seed: np.random.default_rng(seed).random((9, 12)) < 0.55)


@settings(max_examples=60, deadline=None)
@given(mask=masks)
def test_euler_characteristic_counts_regions_less_holes(mask: np.ndarray) -> None:
    outside = ~np.pad(mask, 1)
    holes = label_regions(outside, diagonal=True)[1] - 1
    assert euler_characteristic(mask) == label_regions(mask)[1] - holes


@settings(max_examples=60, deadline=None)
@given(mask=masks, diagonal=st.booleans())
def test_labels_equal_a_plain_flood_fill(mask: np.ndarray, diagonal: bool) -> None:
    labels, count = label_regions(mask, diagonal=diagonal)
    expected = np.zeros(mask.shape, dtype=int)
    made = 0
    for row, column in np.argwhere(mask).tolist():
        if expected[row, column]:
            continue
        made += 1
        stack = [(row, column)]
        while stack:
            y, x = stack.pop()
            if not (0 <= y < 9 and 0 <= x < 12) or not mask[y, x] or expected[y, x]:
                continue
            expected[y, x] = made
            steps = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if diagonal or dy == 0 or dx == 0]
            stack += [(y + dy, x + dx) for dy, dx in steps]
    assert count == made and np.array_equal(labels, expected)


@settings(max_examples=40, deadline=None)
@given(mask=masks, side=st.integers(1, 4))
def test_opening_is_the_union_of_all_squares_that_fit(mask: np.ndarray, side: int) -> None:
    expected = np.zeros_like(mask)
    for row in range(9 - side + 1):
        for column in range(12 - side + 1):
            square = (slice(row, row + side), slice(column, column + side))
            if mask[square].all():
                expected[square] = True
    assert np.array_equal(open_by_square(mask, side), expected)


def test_shortest_distance_is_near_the_straight_line() -> None:
    free = np.ones((120, 160), dtype=bool)
    for target in ((2, 150), (110, 150), (110, 60)):
        straight = math.hypot(target[0] - 2, target[1] - 2)
        assert straight - 6 <= shortest_distance(free, (2, 2), target) <= 1.03 * straight + 6
    free[:, 80] = False
    assert math.isinf(shortest_distance(free, (2, 2), (2, 150)))
    free[60:62, 80] = True  # narrower than the coarse search's squares
    assert 180 < shortest_distance(free, (2, 2), (2, 150)) < 200


def test_distance_of_distributions() -> None:
    values = np.random.default_rng(0).normal(size=4000)
    assert distance(values, values) == 0.0
    assert distance(values, values + 1.0) == pytest.approx(1.0, abs=0.02)
    assert math.isnan(distance(values, np.array([np.nan])))


@pytest.mark.slow
@pytest.mark.skipif(not PUBLIC.is_dir(), reason="public maps are not in ../shared/data/maps")
@pytest.mark.parametrize("style", ["exploration", "navigation"])
def test_rooms_look_like_the_public_maps(style: str) -> None:
    specs = (str(PUBLIC / style / "train"), f"generator:rooms?style={style}")
    public, made = (measure_all(fixed_set(open_sources([spec], 0.25, "exploration"), 300)) for spec in specs)
    for name in ("free_blocks", "rooms", "loops", "corridor_share", "extent_x", "extent_y"):
        assert distance(public[name], made[name]) < 0.35, name


def test_commands(tmp_path: Path) -> None:
    runner = CliRunner()
    small = "generator:rooms?width=192&height=192"
    written = runner.invoke(app, ["write", small, "--out", str(tmp_path / "maps"), "--count", "6"])
    assert written.exit_code == 0, written.output
    assert load_image(tmp_path / "maps" / "5.png", require_target=True).size == (48.0, 48.0)
    sheet = tmp_path / "sheet.png"
    assert runner.invoke(app, ["show", str(tmp_path / "maps"), "--out", str(sheet)]).exit_code == 0
    assert sheet.stat().st_size > 200
    compared = runner.invoke(
        app,
        ["compare", "--maps", str(tmp_path / "maps"), "--generator", small.split(":")[1], "--count", "6", "--markdown"],
    )
    assert compared.exit_code == 0 and "| loops |" in compared.output
    wrong = runner.invoke(app, ["show", "generator:nope", "--out", str(sheet)])
    assert wrong.exit_code == 1 and "no generator 'nope'" in wrong.output
    missing = runner.invoke(app, ["show", small, "--out", str(tmp_path / "no" / "a.png")])
    assert missing.exit_code == 1 and "make it first" in missing.output


def test_sets_without_any_spread_are_the_same_or_infinitely_far_apart() -> None:
    ones = np.ones(5)
    assert distance(ones, ones) == 0.0
    assert distance(ones, np.array([1.0, 2.0, 3.0])) == np.inf
