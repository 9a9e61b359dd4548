from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from actors.maps.layout import build_map
from actors.maps.png import list_png, load_png, write_png
from common.errors import MapError
from tests.actors.maps.images import FREE, START, TARGET, paint, simple

PUBLIC = Path(__file__).parents[4] / "shared" / "data" / "maps"


def test_markers_areas_and_frames(tmp_path: Path) -> None:
    world = load_png(simple(tmp_path / "a.png"), 0.25)
    # Row 0 is the bottom: the corridor is 16 to 32 px below the top of 64.
    assert world.free.shape == (64, 96)
    assert world.free[32:48, 16:80].all() and np.count_nonzero(world.free) == 16 * 64
    assert world.free_area == 16 * 64 * 0.25**2
    assert world.start == (24 * 0.25, 40 * 0.25)
    assert world.target == (72 * 0.25, 40 * 0.25)
    assert world.target_region is not None and np.count_nonzero(world.target_region) == 256
    assert world.is_free(world.start) and world.is_free(world.target)
    assert (world.name, world.origin, world.size) == ("a.png", (0.0, 0.0), (24.0, 16.0))


@pytest.mark.parametrize("scale", [0.25, 0.5, 0.1])
def test_lattice_goes_through_the_block_centres_at_any_scale(tmp_path: Path, scale: float) -> None:
    world = load_png(simple(tmp_path / "a.png"), scale)
    assert world.lattice_origin == pytest.approx((8 * scale, 8 * scale))
    steps = (np.array(world.start) - world.lattice_origin) / (16 * scale)
    assert steps == pytest.approx(np.round(steps))


def test_lattice_is_counted_from_the_top_of_odd_heights(tmp_path: Path) -> None:
    path = paint(tmp_path / "a.png", [(0, 0, 64, 50)], [((16, 16, 32, 32), START)], size=(64, 50))
    world = load_png(path, 1.0)
    assert world.start == (24.0, 26.0)
    assert world.lattice_origin == (8.0, 10.0)


def test_anti_aliased_target_is_one_marker(tmp_path: Path) -> None:
    corner = [((64, 16, 65, 17), (242, 80, 19)), ((64, 17, 65, 18), (240, 41, 27))]
    path = paint(
        tmp_path / "a.png",
        [(16, 16, 80, 32)],
        [((16, 16, 32, 32), (255, 217, 0)), ((64, 16, 80, 32), TARGET), *corner],
    )
    assert load_png(path).target == (18.0, 10.0)


def test_a_map_without_a_target_serves_exploration_only(tmp_path: Path) -> None:
    path = simple(tmp_path / "a.png", target=False)
    world = load_png(path)
    assert world.target is None and world.target_region is None
    with pytest.raises(MapError, match=r"a\.png: expected one target marker .* none: use navigation maps"):
        load_png(path, require_target=True)


@pytest.mark.parametrize(
    ("free", "markers", "message"),
    [
        ([(16, 16, 80, 32)], [], "expected one start marker .* none: paint one"),
        (
            [(16, 16, 80, 32)],
            [((16, 16, 32, 32), START), ((48, 16, 64, 32), START)],
            "expected one start marker .* found 2",
        ),
        ([(48, 16, 80, 32)], [((16, 16, 32, 32), START)], "start is enclosed"),
        (
            [(16, 16, 40, 32)],
            [((16, 16, 32, 32), START), ((64, 16, 80, 32), TARGET)],
            "no free way leads from start to target",
        ),
        (
            [(16, 16, 80, 32)],
            [((16, 16, 32, 32), START), ((40, 16, 50, 32), TARGET), ((64, 16, 80, 32), TARGET)],
            "expected one target marker .* found 2",
        ),
    ],
)
def test_wrong_markers_are_named(tmp_path: Path, free: list, markers: list, message: str) -> None:
    with pytest.raises(MapError, match=message):
        load_png(paint(tmp_path / "a.png", free, markers))


def test_files_that_are_no_maps(tmp_path: Path) -> None:
    text = tmp_path / "text.png"
    text.write_text("no image")
    with pytest.raises(MapError, match="expected a PNG image"):
        load_png(text)
    with pytest.raises(MapError, match="cannot read the map"):
        load_png(tmp_path / "missing.png")
    small = tmp_path / "small.png"
    Image.new("RGB", (8, 8), FREE).save(small)
    with pytest.raises(MapError, match="640 x 480.*got 8 x 8"):
        load_png(small)
    whole = simple(tmp_path / "whole.png").read_bytes()
    broken = tmp_path / "broken.png"
    broken.write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(MapError, match="cannot read the map"):
        load_png(broken)


def test_round_trip(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    free = rng.random((64, 96)) < 0.9
    free[8:32, 8:90] = True
    world = build_map("a", free, 0.25, (16, 20), (70, 20))
    write_png(world, tmp_path / "a.png")
    again = load_png(tmp_path / "a.png", 0.25)
    assert np.array_equal(again.free, world.free)
    assert (again.start, again.target, again.lattice_origin) == (world.start, world.target, world.lattice_origin)
    assert world.target_region is not None and np.array_equal(again.target_region, world.target_region)
    with pytest.raises(MapError, match="cannot write the map"):
        write_png(world, tmp_path / "no" / "a.png")


def test_start_beside_a_wall_keeps_its_place(tmp_path: Path) -> None:
    free = np.zeros((64, 96), dtype=np.bool_)
    free[10:50, 10:90] = True
    world = build_map("a", free, 1.0, (13, 20), None)
    write_png(world, tmp_path / "a.png")
    again = load_png(tmp_path / "a.png", 1.0)
    assert again.start == (13.0, 20.0) and np.array_equal(again.free, free)


def test_files_are_listed_in_natural_order(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    for name in ("img_10.png", "img_2.png", "img_1.PNG", "notes.txt", "sub/3.png", ".hidden.png"):
        (tmp_path / name).touch()
    listed = [path.relative_to(tmp_path).as_posix() for path in list_png(tmp_path)]
    assert listed == ["img_1.PNG", "img_2.png", "img_10.png", "sub/3.png"]


@pytest.mark.skipif(not PUBLIC.is_dir(), reason="public maps are not in ../shared/data/maps")
def test_public_maps() -> None:
    exploration = list_png(PUBLIC / "exploration" / "train")
    navigation = list_png(PUBLIC / "navigation" / "train")
    assert (len(exploration), len(navigation)) == (5515, 5018)
    # The start marker of 1.png covers columns 432 to 447 and rows 256 to 271 of 480.
    first = load_png(exploration[0])
    assert exploration[0].name == "1.png" and first.start == (440 * 0.25, (480 - 264) * 0.25)
    assert first.lattice_origin == (2.0, 2.0)
    # Markers on half blocks: 272 to 287 and 336 to 351; the target's colours differ in three pixels.
    second = load_png(navigation[0], require_target=True)
    assert second.start == (280 * 0.25, (480 - 344) * 0.25) and second.target == (128.0, (480 - 312) * 0.25)
    assert second.target_region is not None and np.count_nonzero(second.target_region) == 256
    areas = [load_png(path).free_area for path in exploration[::200]]
    assert 3800 < np.mean(areas) < 4900
    for path in navigation[::200]:
        load_png(path, require_target=True)
