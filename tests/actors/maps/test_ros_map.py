import math
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from actors.maps.images import Pixels, read_pixels
from actors.maps.ros_map import MapServerFile, load_ros_map, names_image, occupancy, read_map_server_file
from common.errors import MapError
from tests.actors.maps.ros_files import FREE, UNKNOWN, WALL, room, write_ros

CENTRE = (1.5, 1.0)


def test_a_map_lies_where_its_origin_says(tmp_path: Path) -> None:
    path = write_ros(tmp_path / "plan.yaml", origin=[-10.5, 3.0, 0.0])
    world = load_ros_map(path, start=(-9.0, 4.0), target=(-8.5, 4.2), require_target=True)
    assert (world.name, world.resolution, world.origin) == ("plan.yaml", 0.05, (-10.5, 3.0))
    assert (world.start, world.target, world.target_region) == ((-9.0, 4.0), (-8.5, 4.2), None)
    assert np.array_equal(world.free, (room() == FREE)[::-1])


def test_walls_and_unknown_space_are_not_free(tmp_path: Path) -> None:
    pixels = room()
    pixels[8:12, 10:20] = UNKNOWN
    for image in ("map.pgm", "map.png", "map.bmp"):
        world = load_ros_map(write_ros(tmp_path / "plan.yaml", pixels, image), start=CENTRE)
        assert np.array_equal(world.free, (pixels == FREE)[::-1])
    for place in ((0.1, 0.1), (0.75, 1.5)):
        with pytest.raises(MapError, match="the start .* is occupied or unknown"):
            load_ros_map(tmp_path / "plan.yaml", start=place)


def test_what_map_saver_writes_for_unknown_stays_unknown_with_the_thresholds_of_nav2(tmp_path: Path) -> None:
    pixels = room()
    pixels[20:22, 20:22] = 204
    world = load_ros_map(write_ros(tmp_path / "plan.yaml", pixels, free_thresh=0.25), start=CENTRE)
    expected = (pixels == FREE) | (pixels == 204)
    assert np.array_equal(world.free, expected[::-1])


def test_negate_makes_dark_free(tmp_path: Path) -> None:
    for negate in (1, "true", "True"):
        path = write_ros(tmp_path / "plan.yaml", 255 - room(), negate=negate)
        assert np.array_equal(load_ros_map(path, start=CENTRE).free, (room() == FREE)[::-1])


GRAYS = np.arange(256, dtype=np.uint8)


def pixels_of(rgba: np.ndarray, has_alpha: bool = False) -> Pixels:
    return Pixels(rgba.astype(np.uint8), None, (1, len(rgba)), has_alpha, lossy=False)


def gray_values(file: MapServerFile) -> np.ndarray:
    opaque = np.column_stack([GRAYS, GRAYS, GRAYS, np.full(256, 255)])
    return occupancy(pixels_of(opaque), file)[0]


def file_of(mode: str = "trinary", free: float = 0.196, occupied: float = 0.65, negate: bool = False) -> MapServerFile:
    return MapServerFile(Path("map.pgm"), 0.05, (0.0, 0.0), 0.0, negate, occupied, free, mode)


def cell_of_nav2(red: int, green: int, blue: int, alpha: int, has_alpha: bool, file: MapServerFile) -> int:
    """One pixel as map_server's loader treats it, step by step."""
    channels = [red, green, blue] + ([alpha] if file.mode == "trinary" and has_alpha else [])
    shade = sum(channels) / (255 * len(channels))
    occupied = shade if file.negate else 1.0 - shade
    if file.mode == "raw":
        value = math.floor(shade * 255 + 0.5)
        return value if value <= 100 else -1
    if file.mode == "scale" and has_alpha and alpha < 255:
        return -1
    if occupied > file.occupied:
        return 100
    if occupied < file.free:
        return 0
    if file.mode == "trinary":
        return -1
    return round((occupied - file.free) / (file.occupied - file.free) * 100)


colour = st.tuples(*[st.integers(0, 255)] * 4)


@settings(max_examples=200)
@given(
    st.lists(colour, min_size=1, max_size=20),
    st.booleans(),
    st.sampled_from(["trinary", "scale", "raw"]),
    st.booleans(),
    st.tuples(st.integers(0, 99), st.integers(1, 100)),
)
def test_every_pixel_is_as_in_map_server(colours, has_alpha, mode, negate, thresholds) -> None:
    free, occupied = sorted(value / 100 for value in thresholds)
    if free == occupied:
        occupied += 0.005
    file = file_of(mode, free, occupied, negate)
    rgba = np.array(colours)
    if not has_alpha:
        rgba[:, 3] = 255
    found = occupancy(pixels_of(rgba, has_alpha), file)[0]
    for pixel, value in zip(rgba.tolist(), found.tolist(), strict=True):
        if pixel[:3] != [UNKNOWN] * 3:
            assert abs(value - cell_of_nav2(*pixel, has_alpha, file)) <= (mode == "scale"), pixel


@pytest.mark.parametrize(
    ("mode", "gray", "value"),
    [
        ("trinary", 254, 0), ("trinary", 205, -1), ("trinary", 0, 100), ("trinary", 89, 100), ("trinary", 90, -1),
        ("scale", 254, 0), ("scale", 0, 100), ("scale", 147, 50), ("raw", 0, 0), ("raw", 100, 100), ("raw", 101, -1),
        ("raw", 255, -1),
    ],
)  # fmt: skip
def test_known_values(mode: str, gray: int, value: int) -> None:
    assert gray_values(file_of(mode))[gray] == value


def test_brighter_is_less_occupied_and_with_negate_more() -> None:
    for mode in ("trinary", "scale"):
        for negate in (False, True):
            values = gray_values(file_of(mode, negate=negate)).astype(int)
            steps = np.diff(values[values >= 0])
            assert steps.any() and ((steps >= 0) if negate else (steps <= 0)).all()


def test_opacity_counts_as_a_channel_in_trinary_and_as_unknown_in_scale(tmp_path: Path) -> None:
    rgba = np.array([(255, 255, 255, 255), (255, 255, 255, 0), (0, 0, 0, 255), (0, 0, 0, 0)])
    assert occupancy(pixels_of(rgba, True), file_of())[0].tolist() == [0, -1, 100, 100]
    assert occupancy(pixels_of(rgba, True), file_of("scale"))[0].tolist() == [0, -1, 100, -1]


def test_scale_and_raw_are_free_up_to_a_quarter(tmp_path: Path) -> None:
    pixels = np.zeros((20, 40), dtype=np.uint8)
    pixels[:, :20] = 25
    pixels[:, 20:30] = 26
    pixels[:, 30:] = 255
    world = load_ros_map(write_ros(tmp_path / "plan.yaml", pixels, mode="raw"), start=(0.5, 0.5))
    assert world.free[:, :20].all() and not world.free[:, 20:].any()
    world = load_ros_map(write_ros(tmp_path / "plan.yaml", mode="Scale"), start=CENTRE)
    assert np.array_equal(world.free, (room() == FREE)[::-1])


def test_a_yellow_or_light_gray_spot_is_no_start(tmp_path: Path) -> None:
    pixels = np.stack([room()] * 3, axis=-1)
    pixels[15:20, 15:20] = (255, 217, 0)
    path = write_ros(tmp_path / "plan.yaml", pixels, "map.png")
    with pytest.raises(MapError, match=r"expected a start, a ROS map has none: .* plan\.yaml\?start=X,Y"):
        load_ros_map(path, start=None)
    with pytest.raises(MapError, match="expected a target for navigation, a ROS map has none"):
        load_ros_map(path, start=(1.5, 1.0), require_target=True)


def test_numbers_in_every_notation_and_images_anywhere(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    write_ros(tmp_path / "images" / "a.yaml")
    path = tmp_path / "b.yaml"
    path.write_bytes(
        b"\xef\xbb\xbfimage: images/map.pgm\nresolution: 5e-2\norigin: [1, -2e0, 0]\nnegate: false\n"
        b"occupied_thresh: 65e-2\nfree_thresh: 0.196\nextra: 3\n"
    )
    file = read_map_server_file(path)
    assert (file.resolution, file.origin, file.mode, file.negate) == (0.05, (1.0, -2.0), "trinary", False)
    assert load_ros_map(path, start=(2.5, -1.0)).origin == (1.0, -2.0)
    path.write_text(path.read_text("utf-8-sig").replace("images/map.pgm", str(tmp_path / "images" / "map.pgm")))
    assert load_ros_map(path, start=(2.5, -1.0)).free.any()


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"image": None}, "image is missing: add it"),
        ({"resolution": None, "negate": None}, "resolution, negate is missing"),
        ({"resolution": 0}, "expected resolution in metres per pixel, 0 to 10, got 0"),
        ({"resolution": "wide"}, "expected resolution to be a number, got 'wide'"),
        ({"resolution": ".nan"}, "expected resolution to be a number, got nan"),
        ({"origin": [0.0, 0.0]}, r"expected origin to be \[x, y, yaw\] in metres and radians, got \[0\.0, 0\.0\]"),
        ({"origin": "here"}, "expected origin to be"),
        ({"origin": [1e308, 0.0, 0.0]}, "expected origin in metres of at most"),
        ({"free_thresh": 0.7}, "expected 0 <= free_thresh <= occupied_thresh <= 1, got 0.7 and 0.65"),
        ({"occupied_thresh": 65}, "free_thresh <= occupied_thresh <= 1, got 0.196 and 65"),
        ({"negate": 2}, "expected negate to be 0 or 1, got 2"),
        ({"mode": "colour"}, "expected mode to be trinary, scale or raw, got 'colour'"),
        ({"mode": "[" + "a, " * 400 + "]"}, r"\.\.\.: correct it"),
        ({"image": "[1, 2]"}, "expected image to be the name of a file"),
    ],
)
def test_wrong_fields_are_named(tmp_path: Path, fields: dict, message: str) -> None:
    path = write_ros(tmp_path / "plan.yaml", **({} if "image" in fields else fields))
    if "image" in fields:
        lines = [line for line in path.read_text().splitlines() if not line.startswith("image")]
        path.write_text("\n".join(lines + [f"image: {fields['image']}"] * (fields["image"] is not None)))
    with pytest.raises(MapError, match=message) as raised:
        load_ros_map(path, start=CENTRE)
    assert len(str(raised.value).splitlines()) == 1 and len(str(raised.value)) < 400 + len(str(path))


def test_a_key_that_is_there_twice_is_an_error_with_both_lines(tmp_path: Path) -> None:
    path = write_ros(tmp_path / "plan.yaml")
    path.write_text("# A map.\n" + path.read_text() + "resolution: 0.1\n")
    with pytest.raises(MapError, match=r"expected each key once, got 'resolution' in lines 3 and 8: leave one out"):
        load_ros_map(path, start=(1.0, 1.0))


@pytest.mark.parametrize("kind", ["P2", "P5"])
@pytest.mark.parametrize(
    ("white", "values"),
    [
        (255, [0, 100, 204, 205, 206, 254, 255]),
        (254, [0, 100, 204, 205, 206, 253, 254]),
        (100, [0, 34, 36, 80, 81, 99, 100]),
        (1, [0, 1]),
        (1023, [0, 351, 352, 822, 824, 1023]),
        (65535, [0, 100 * 257, 205 * 257, 206 * 257, 65535]),
    ],
)
def test_values_of_a_pgm_count_by_the_white_of_its_header(tmp_path: Path, kind: str, white: int, values: list) -> None:
    """As netpbm says; 205, or the nearest to its shade, is what map_saver writes for unknown."""
    path = write_ros(tmp_path / "plan.yaml", free_thresh=0.25)
    plain = " ".join(map(str, values)).encode()
    data = plain if kind == "P2" else np.array(values, dtype=np.uint8 if white < 256 else ">u2").tobytes()
    (tmp_path / "map.pgm").write_bytes(f"{kind} # white is {white}\n{len(values)} 1\n{white}\n".encode() + data)
    shades = np.array(values) / white
    expected = np.where(1.0 - shades > 0.65, 100, np.where(1.0 - shades < 0.25, 0, -1))
    expected[(np.array(values) == 205) & (white < 256) | (np.abs(shades * 255 - 205) < 0.5)] = -1
    assert occupancy(read_pixels(tmp_path / "map.pgm"), read_map_server_file(path)).tolist() == [expected.tolist()]


def test_the_unknown_of_map_saver_is_found_however_the_image_is_stored(tmp_path: Path) -> None:
    """Behind a long comment, in colours, and in 16 bits that came about by a shift."""
    path = write_ros(tmp_path / "plan.yaml", free_thresh=0.25)
    size, pixels = b"60 40", room()
    for data in (
        b"P5\n#" + b" made by hand" * 500 + b"\n" + size + b" 254\n" + pixels.tobytes(),
        b"P6 " + size + b" 254\n" + np.repeat(pixels.ravel(), 3).tobytes(),
        b"P5 " + size + b" 65535\n" + (pixels.astype(np.uint16) << 8).astype(">u2").tobytes(),
    ):
        (tmp_path / "map.pgm").write_bytes(data)
        assert np.array_equal(load_ros_map(path, start=CENTRE).free, (pixels == FREE)[::-1])


def test_a_start_that_is_no_number_is_named(tmp_path: Path) -> None:
    path = write_ros(tmp_path / "plan.yaml")
    for places in ({"start": (math.nan, 1.0)}, {"start": CENTRE, "target": (1.0, math.inf)}):
        with pytest.raises(MapError, match=r"plan.yaml: expected the (start|target) \(x, y\) in metres"):
            load_ros_map(path, **places)


def test_an_image_whose_name_no_system_takes_is_named(tmp_path: Path) -> None:
    path = write_ros(tmp_path / "plan.yaml", image="map.pgm")
    path.write_text(path.read_text().replace("map.pgm", "m" * 300 + ".pgm"))
    with pytest.raises(MapError, match="there is no such file: correct the field image"):
        load_ros_map(path, start=CENTRE)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "plan.yaml: expected the YAML file of a ROS map, got an empty file"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "plan.yaml is a pointer of Git LFS"),
        ("image: mäp.pgm\n".encode("latin-1"), "expected text in UTF-8, got byte 0xe4 at 8 .*: save it as UTF-8"),
        (b"image: a\0b", "expected text in UTF-8, got zeros"),
        (b"just words", "got str"),
        (b"", "got an empty file"),
        (b"a: [1, 2", "got something else"),
        (b"[" * 30_000, "got something else"),
        (b"a: 1\n---\na: 2\n", "got something else"),
        (b"!!python/object/apply:os.system ['true']", "got something else"),
        (b"a: 2024-13-45", "got something else|is missing"),
        (b"#" * 70_000, "got 70,000 bytes: name another file"),
        (b"&a [*a, *a]", "got list"),
    ],
)
def test_files_that_are_no_maps(tmp_path: Path, data: bytes, message: str) -> None:
    path = tmp_path / "plan.yaml"
    path.write_bytes(data)
    with pytest.raises(MapError, match=message):
        read_map_server_file(path)
    assert not names_image(path)


def test_images_that_are_missing_or_no_images(tmp_path: Path) -> None:
    path = write_ros(tmp_path / "plan.yaml")
    (tmp_path / "map.pgm").write_text("P5 no image")
    with pytest.raises(MapError, match=r"map\.pgm: "):
        load_ros_map(path, start=CENTRE)
    (tmp_path / "map.pgm").unlink()
    with pytest.raises(MapError, match=r"plan\.yaml: expected its image at .*map\.pgm, there is no such file"):
        load_ros_map(path, start=CENTRE)
    with pytest.raises(MapError, match="there is no such file: check the path"):
        load_ros_map(tmp_path / "no.yaml", start=CENTRE)
    # A header that promises a terabyte is refused before anything is unpacked.
    (tmp_path / "map.pgm").write_bytes(b"P5\n1000000 1000000\n255\n")
    with pytest.raises(MapError, match="at most 8192 x 8192 px, got many more: scale it down"):
        load_ros_map(path, start=CENTRE)


@given(st.binary(max_size=200))
@settings(max_examples=100)
def test_bytes_of_any_kind_are_one_clear_error(data: bytes) -> None:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plan.yaml"
        path.write_bytes(data)
        with pytest.raises(MapError):
            read_map_server_file(path)
        path.write_bytes(b"image: x\nresolution: " + data)
        with pytest.raises(MapError):
            load_ros_map(path, start=CENTRE)


@settings(max_examples=30)
@given(st.floats(-7.0, 7.0), st.tuples(st.floats(-50, 50), st.floats(-50, 50)))
def test_places_of_a_turned_map_are_where_its_origin_says(tmp_path_factory, yaw, origin) -> None:
    folder = tmp_path_factory.mktemp("turned")
    pixels = room()
    pixels[6:12, 6:20] = WALL
    path = write_ros(folder / "plan.yaml", pixels, origin=[*origin, yaw])
    cosine, sine = math.cos(yaw), math.sin(yaw)

    def placed(x: float, y: float) -> tuple[float, float]:
        return origin[0] + cosine * x - sine * y, origin[1] + sine * x + cosine * y

    world = load_ros_map(path, start=placed(*CENTRE))
    assert world.resolution == read_map_server_file(path).cell
    rng = np.random.default_rng(0)
    for x, y in rng.uniform((0.0, 0.0), (3.0, 2.0), size=(100, 2)):
        row, column = 39 - int(y / 0.05), int(x / 0.05)
        # A cell of the new grid takes what its centre lies on, so borders move by less than its diagonal.
        around = pixels[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2] == FREE
        if around.all() or not around.any():
            assert world.is_free(placed(x, y)) == bool(around.all())


def test_right_angles_are_exact(tmp_path: Path) -> None:
    for quarters, yaw in ((1, "1.5708"), (2, "3.14159"), (3, "-1.5707963"), (4, "6.283185"), (1, "1.5707963267948966")):
        path = write_ros(tmp_path / "plan.yaml", origin=f"[0.0, 0.0, {yaw}]")
        corner = [(0.0, 0.0), (-2.0, 0.0), (-3.0, -2.0), (0.0, -3.0)][quarters % 4]
        middle = (corner[0] + (1.0 if quarters % 2 else 1.5), corner[1] + (1.5 if quarters % 2 else 1.0))
        world = load_ros_map(path, start=middle)
        assert world.resolution == 0.05 and world.origin == pytest.approx(corner)
        assert np.array_equal(world.free, np.rot90((room() == FREE)[::-1], -quarters))


def test_an_image_of_colours_is_read_by_the_mean_of_its_channels(tmp_path: Path) -> None:
    pixels = np.full((20, 40, 3), 255, dtype=np.uint8)
    pixels[:, 20:] = (255, 255, 0)
    Image.fromarray(pixels).save(tmp_path / "map.png")
    path = write_ros(tmp_path / "plan.yaml", pixels, "map.png")
    world = load_ros_map(path, start=(0.5, 0.5))
    assert world.free[:, :20].all() and not world.free[:, 20:].any()


def test_lists_without_end_are_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "plan.yaml"
    path.write_text("a: " + "[" * 30_000)
    began = time.process_time()
    with pytest.raises(MapError, match="lists without end"):
        read_map_server_file(path)
    assert time.process_time() - began < 1.0
