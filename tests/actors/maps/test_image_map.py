import math
import resource
import struct
import time
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from actors.maps.files import list_maps
from actors.maps.image_map import load_image
from actors.maps.images import read_pixels
from actors.maps.layout import build_map
from actors.maps.png import write_png
from common.errors import MapError
from tests.actors.maps.images import FREE, OCCUPIED, START, TARGET, paint, simple

PUBLIC = Path(__file__).parents[4] / "shared" / "data" / "maps"


def test_markers_areas_and_frames(tmp_path: Path) -> None:
    world = load_image(simple(tmp_path / "a.png"), 0.25)
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
    world = load_image(simple(tmp_path / "a.png"), scale)
    assert world.lattice_origin == pytest.approx((8 * scale, 8 * scale))
    steps = (np.array(world.start) - world.lattice_origin) / (16 * scale)
    assert steps == pytest.approx(np.round(steps))


def test_lattice_is_counted_from_the_top_of_odd_heights(tmp_path: Path) -> None:
    path = paint(tmp_path / "a.png", [(0, 0, 64, 50)], [((16, 16, 32, 32), START)], size=(64, 50))
    world = load_image(path, 1.0)
    assert world.start == (24.0, 26.0)
    assert world.lattice_origin == (8.0, 10.0)


def test_anti_aliased_target_is_one_marker(tmp_path: Path) -> None:
    corner = [((64, 16, 65, 17), (242, 80, 19)), ((64, 17, 65, 18), (240, 41, 27))]
    path = paint(
        tmp_path / "a.png",
        [(16, 16, 80, 32)],
        [((16, 16, 32, 32), (255, 217, 0)), ((64, 16, 80, 32), TARGET), *corner],
    )
    assert load_image(path).target == (18.0, 10.0)


def test_a_map_without_a_target_serves_exploration_only(tmp_path: Path) -> None:
    path = simple(tmp_path / "a.png", target=False)
    world = load_image(path)
    assert world.target is None and world.target_region is None
    with pytest.raises(MapError, match=r"a\.png: expected one target marker .* none: use navigation maps"):
        load_image(path, require_target=True)


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
        load_image(paint(tmp_path / "a.png", free, markers))


def test_files_that_are_no_maps(tmp_path: Path) -> None:
    text = tmp_path / "text.png"
    text.write_text("no image")
    with pytest.raises(MapError, match="expected an image .*got something else: convert it"):
        load_image(text)
    with pytest.raises(MapError, match="there is no such file: check the path"):
        load_image(tmp_path / "missing.png")
    large = tmp_path / "large.png"
    Image.new("1", (8193, 8)).save(large)
    with pytest.raises(MapError, match="at most 8192 x 8192 px, got 8193 x 8: scale it down"):
        load_image(large)
    whole = simple(tmp_path / "whole.png").read_bytes()
    broken = tmp_path / "broken.png"
    broken.write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(MapError, match="cannot read the image"):
        load_image(broken)


def test_round_trip(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    free = rng.random((64, 96)) < 0.9
    free[8:32, 8:90] = True
    world = build_map("a", free, 0.25, (16, 20), (70, 20))
    write_png(world, tmp_path / "a.png")
    again = load_image(tmp_path / "a.png", 0.25)
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
    again = load_image(tmp_path / "a.png", 1.0)
    assert again.start == (13.0, 20.0) and np.array_equal(again.free, free)


YELLOWS = [(255, 216, 0), (255, 217, 0), (230, 210, 60), (255, 255, 0), (212, 175, 55), (255, 190, 0), (200, 255, 0)]
REDS = [(238, 22, 31), (242, 80, 19), (255, 0, 0), (139, 0, 0), (220, 20, 60), (255, 99, 71)]
NO_MARKERS = [(205, 205, 205), (212, 212, 212), (70, 70, 70), (255, 165, 0), (0, 200, 0), (0, 0, 255), (255, 192, 203)]


@pytest.mark.parametrize("colour", YELLOWS)
def test_any_yellow_is_a_start(tmp_path: Path, colour: tuple) -> None:
    world = load_image(paint(tmp_path / "a.png", [(16, 16, 80, 32)], [((20, 18, 27, 25), colour)]), 1.0)
    assert world.start == (23.5, 64 - 21.5) and world.is_free(world.start) and world.target is None


@pytest.mark.parametrize("colour", REDS)
def test_any_red_is_a_target(tmp_path: Path, colour: tuple) -> None:
    markers = [((16, 16, 32, 32), START), ((60, 18, 67, 25), colour)]
    world = load_image(paint(tmp_path / "a.png", [(16, 16, 80, 32)], markers), 1.0)
    assert world.target == (63.5, 64 - 21.5) and world.is_free(world.target)


@pytest.mark.parametrize("colour", NO_MARKERS)
def test_other_colours_are_no_markers(tmp_path: Path, colour: tuple) -> None:
    path = paint(tmp_path / "a.png", [(16, 16, 80, 32)], [((60, 18, 67, 25), colour)])
    with pytest.raises(MapError, match=r"expected one start marker .* --start X Y or a\.png\?start=X,Y"):
        load_image(path)
    assert load_image(path, start=(5.0, 10.0)).target is None


def test_the_gray_that_ros_writes_for_unknown_is_not_free(tmp_path: Path) -> None:
    path = paint(tmp_path / "a.png", [(16, 16, 80, 32)], [((40, 16, 44, 32), (205, 205, 205))])
    world = load_image(path, 1.0, start=(20.0, 40.0))
    assert not world.free[:, 40:44].any() and world.free[32:48, 44:80].all()
    with pytest.raises(MapError, match=r"the start \(43\.00, 40\.00\) is occupied or unknown.* nearest is \(44\.50"):
        load_image(path, 1.0, start=(43.0, 40.0))


def test_start_and_target_in_metres(tmp_path: Path) -> None:
    path = paint(tmp_path / "a.png", [(16, 16, 80, 32)], [])
    world = load_image(path, 0.1, start=(2.0, 4.0), target=(7.5, 3.5), require_target=True, name="office")
    assert (world.name, world.start, world.target, world.target_region) == ("office", (2.0, 4.0), (7.5, 3.5), None)
    assert (world.origin, world.resolution, world.size) == ((0.0, 0.0), 0.1, pytest.approx((9.6, 6.4)))
    # What is given wins over what is painted, however often that is.
    both = [((16, 16, 20, 20), START), ((60, 16, 64, 20), START), ((30, 20, 34, 24), TARGET)]
    world = load_image(paint(tmp_path / "b.png", [(16, 16, 80, 32)], both), 0.1, start=(5.0, 4.0))
    assert world.start == (5.0, 4.0) and world.target == pytest.approx((3.2, 4.2)) and world.free[32:48, 16:80].all()
    assert world.target_region is not None and np.count_nonzero(world.target_region) == 16


@pytest.mark.parametrize(
    ("start", "target", "message"),
    [
        ((1.0, 4.0), None, r"the start \(1\.00, 4\.00\) is occupied or unknown: choose .* nearest is \(1\.65, 3\.95\)"),
        ((-1.0, 4.0), None, r"the start .* is outside the map \(\(0\.00, 0\.00\) to \(9\.60, 6\.40\)\)"),
        ((2.0, 9.0), None, "the start .* is outside the map"),
        ((0.55, 0.55), None, r"only 0\.04 m2 can be reached from the start"),
        ((2.0, 4.0), (0.55, 0.55), "no free way leads from start to target"),
        ((2.0, 4.0), (4.0, 1.0), "the target .* is occupied or unknown"),
    ],
)
def test_places_that_do_not_suit(tmp_path: Path, start: tuple, target: tuple | None, message: str) -> None:
    path = paint(tmp_path / "a.png", [(16, 16, 80, 32), (5, 58, 7, 60)], [])
    with pytest.raises(MapError, match=message):
        load_image(path, 0.1, start=start, target=target)


def test_an_image_without_free_space(tmp_path: Path) -> None:
    with pytest.raises(MapError, match="expected free space, every pixel is occupied or unknown"):
        load_image(paint(tmp_path / "a.png", [], []), start=(1.0, 1.0))


@pytest.mark.parametrize("size", [(5, 3), (33, 47), (101, 7)])
def test_sizes_need_be_multiples_of_nothing(tmp_path: Path, size: tuple) -> None:
    world = load_image(paint(tmp_path / "a.png", [(0, 0, *size)], [], size=size), 0.3, start=(0.4, 0.5))
    assert world.free.shape == size[::-1] and world.free.all()


@pytest.mark.parametrize("quality", [30, 75, 95])
def test_jpg_artefacts_are_seen_through(tmp_path: Path, quality: int) -> None:
    markers = [((20, 18, 31, 29), START), ((60, 18, 71, 29), TARGET)]
    exact = load_image(paint(tmp_path / "a.png", [(16, 16, 80, 32), (40, 32, 46, 60)], markers), 0.1)
    with Image.open(tmp_path / "a.png") as picture:
        picture.save(tmp_path / "a.jpg", quality=quality)
    world = load_image(tmp_path / "a.jpg", 0.1)
    assert exact.target is not None and world.target is not None
    assert np.hypot(*np.subtract(world.start, exact.start)) < 0.15
    assert np.hypot(*np.subtract(world.target, exact.target)) < 0.15
    assert np.mean(world.free != exact.free) < 0.01
    # Inside the rooms nothing is lost, and walls stay closed two pixels beside them.
    assert world.free[34:46, 18:78].all() and not world.free[52:, :].any()


def test_gray_transparent_and_deep_images(tmp_path: Path) -> None:
    free = np.zeros((40, 50), dtype=np.bool_)
    free[10:30, 5:45] = True
    gray = np.where(free, 254, 0).astype(np.uint8)
    files = {
        "eight.png": Image.fromarray(gray),
        "eight.pgm": Image.fromarray(gray),
        "eight.bmp": Image.fromarray(gray),
        "sixteen.png": Image.fromarray(gray.astype(np.uint16) * 257),
        "one.png": Image.fromarray(gray).convert("1"),
        "palette.png": Image.fromarray(gray).convert("P"),
        "alpha.png": Image.fromarray(np.dstack([np.full_like(gray, 254), np.where(free, 255, 0).astype(np.uint8)])),
    }
    for name, picture in files.items():
        picture.save(tmp_path / name)
        world = load_image(tmp_path / name, 1.0, start=(20.0, 20.0))
        assert np.array_equal(world.free, free[::-1]), name


@pytest.mark.parametrize("value", [204, 206, 209])
def test_a_public_map_in_gray_keeps_its_start(tmp_path: Path, value: int) -> None:
    gray = np.full((128, 160), 127, np.uint8)
    gray[20:100, 20:140] = 195
    gray[40:56, 40:56] = value
    walls = np.where(gray == 127, 0, 255).astype(np.uint8)
    files = {
        "eight.png": Image.fromarray(gray),
        "sixteen.png": Image.fromarray(gray.astype(np.uint16) * 257),
        "transparent.png": Image.fromarray(np.dstack([np.where(gray == 127, 255, gray)] * 3 + [walls])),
    }
    for name, picture in files.items():
        picture.save(tmp_path / name)
        world = load_image(tmp_path / name, 1.0)
        assert world.start == (48.0, 80.0) and np.array_equal(world.free, (gray != 127)[::-1]), name
    world = load_image(tmp_path / "eight.png", 1.0, start=(30.0, 40.0))
    assert world.start == (30.0, 40.0)


def test_gray_floors_of_any_shade_are_no_start(tmp_path: Path) -> None:
    gray = np.full((64, 96), 127, np.uint8)
    gray[10:50, 10:80] = 195
    gray[15:20, 15:20] = gray[30:35, 30:35] = 206
    Image.fromarray(gray).save(tmp_path / "two.png")
    tinted = np.dstack([gray] * 3)
    tinted[30:35, 30:35] = 195
    tinted[45, 70] = (200, 200, 190)
    Image.fromarray(tinted).save(tmp_path / "tinted.png")
    for name in ("two.png", "tinted.png"):
        with pytest.raises(MapError, match="expected one start marker .* found none"):
            load_image(tmp_path / name)


def test_photographs_are_turned_as_their_camera_says(tmp_path: Path) -> None:
    pixels = np.full((40, 80, 3), OCCUPIED, dtype=np.uint8)
    pixels[8:32, 8:72] = FREE
    exif = Image.Exif()
    exif[0x0112] = 6
    picture = Image.fromarray(pixels)
    picture.save(tmp_path / "a.jpg", exif=exif, quality=95)
    # Phones put a small preview behind the picture.
    preview = {"format": "MPO", "save_all": True, "append_images": [picture.resize((20, 10))]}
    picture.save(tmp_path / "b.jpg", exif=exif, quality=95, **preview)
    for name in ("a.jpg", "b.jpg"):
        assert load_image(tmp_path / name, start=(5.0, 10.0)).free.shape == (80, 40)


@pytest.mark.parametrize("scale", [0.0, -0.05, math.nan, math.inf, 1e300])
def test_a_scale_that_is_none_is_named(tmp_path: Path, scale: float) -> None:
    with pytest.raises(MapError, match="a.png: expected metres per pixel above 0"):
        load_image(simple(tmp_path / "a.png"), scale)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "a.png: expected an image .*, got an empty file: copy it again"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "a.png is a pointer of Git LFS"),
        (b"<!doctype html>\n<title>404</title>", "a.png is a web page"),
        (b"Pf\n2 2\n-1.0\n" + bytes(16), "a.png: expected 8 or 16 bits a pixel, got numbers with fractions"),
    ],
)
def test_what_came_in_place_of_an_image_is_told(tmp_path: Path, data: bytes, message: str) -> None:
    (tmp_path / "a.png").write_bytes(data)
    with pytest.raises(MapError, match=message):
        load_image(tmp_path / "a.png")


@pytest.mark.skipif(not PUBLIC.is_dir(), reason="public maps are not in ../shared/data/maps")
def test_public_maps() -> None:
    exploration, navigation = (
        [file.path for file in list_maps(PUBLIC / task / "train")] for task in ("exploration", "navigation")
    )
    assert (len(exploration), len(navigation)) == (5515, 5018)
    # The start marker of 1.png covers columns 432 to 447 and rows 256 to 271 of 480.
    first = load_image(exploration[0])
    assert exploration[0].name == "1.png" and first.start == (440 * 0.25, (480 - 264) * 0.25)
    assert first.lattice_origin == (2.0, 2.0)
    # Markers on half blocks: 272 to 287 and 336 to 351; the target's colours differ in three pixels.
    second = load_image(navigation[0], require_target=True)
    assert second.start == (280 * 0.25, (480 - 344) * 0.25) and second.target == (128.0, (480 - 312) * 0.25)
    assert second.target_region is not None and np.count_nonzero(second.target_region) == 256
    areas = [load_image(path).free_area for path in exploration[::200]]
    assert 3800 < np.mean(areas) < 4900
    for path in navigation[::200]:
        load_image(path, require_target=True)


def gray_rule(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Free space, start and target of a public map by their published gray values, row 0 at the bottom."""
    with Image.open(path) as picture:
        pixels = np.asarray(picture.convert("RGB"), dtype=np.uint32)
    gray = ((2125 * pixels[..., 0] + 7154 * pixels[..., 1] + 721 * pixels[..., 2]) // 10_000)[::-1]
    target = (gray >= 60) & (gray <= 110)
    return (gray > 150) | target, (gray >= 200) & (gray <= 215), target


@pytest.mark.skipif(not PUBLIC.is_dir(), reason="public maps are not in ../shared/data/maps")
def test_the_colours_give_what_the_gray_values_of_public_maps_gave() -> None:
    files = [file.path for file in list_maps(PUBLIC)]
    assert len(files) == 10_944
    for path in files[::150]:
        world = load_image(path, 1.0)
        free, start, target = gray_rule(path)
        assert np.array_equal(world.free, free)
        rows, columns = np.nonzero(start)
        assert world.start == ((columns.min() + columns.max() + 1) / 2, (rows.min() + rows.max() + 1) / 2)
        assert np.array_equal(target, np.zeros_like(free) if world.target_region is None else world.target_region)


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def test_texts_in_pictures_that_grow_without_end_are_refused_at_once(tmp_path: Path) -> None:
    plain = tmp_path / "plain.png"
    Image.new("L", (8, 8)).save(plain)
    head, rest = plain.read_bytes()[:33], plain.read_bytes()[33:]
    once, often = zlib.compress(bytes(100_000_000)), zlib.compress(bytes(900_000))
    for texts in (
        chunk(b"zTXt", b"Comment\0\0" + once),
        chunk(b"iCCP", b"x\0\0" + once),
        b"".join(chunk(b"zTXt", b"C%d\0\0" % number + often) for number in range(200)),
    ):
        path = tmp_path / "bomb.png"
        path.write_bytes(head + texts + rest)
        before, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
        with pytest.raises(MapError, match="cannot read the image"):
            read_pixels(path)
        assert time.process_time() - began < 1.0
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000


def test_the_image_of_a_ros_map_leads_to_its_yaml(tmp_path: Path) -> None:
    path = paint(tmp_path / "a.png", [(16, 16, 80, 32)], [((40, 16, 44, 32), (205, 205, 205))])
    with pytest.raises(MapError, match="image of a ROS map: name its YAML file"):
        load_image(path)
    with pytest.raises(MapError) as raised:
        load_image(paint(tmp_path / "b.png", [(16, 16, 80, 32)], []))
    assert "ROS" not in str(raised.value)
