from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.maps.spec import MapSpec, parse_spec, with_places
from common.errors import MapError


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "plan.yaml").touch()
    (tmp_path / "what?start=1,2.png").touch()
    (tmp_path / "site#3").mkdir()
    return tmp_path


def test_all_parts(folder: Path) -> None:
    path = folder / "plan.yaml"
    assert parse_spec(str(path)) == MapSpec(str(path), "", path)
    text = f"floorplans:{path}?start=1.5,-2&target=3e1,4.25"
    assert parse_spec(text) == MapSpec(text, "floorplans", path, "", (1.5, -2.0), (30.0, 4.25))
    text = f"cmu:{folder}?metres_per_pixel=0.1#train"
    assert parse_spec(text) == MapSpec(text, "cmu", folder, "train", metres_per_pixel=0.1)


def test_a_path_that_exists_is_that_path(folder: Path) -> None:
    for name in ("what?start=1,2.png", "site#3"):
        spec = parse_spec(str(folder / name))
        assert (spec.path, spec.start, spec.split) == (folder / name, None, "")
    spec = parse_spec(f"{folder / 'what?start=1,2.png'}#validation")
    assert (spec.path.name, spec.start, spec.split) == ("what?start=1,2.png", None, "validation")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "an empty source: expected a folder or a map file, got none"),
        ("floorplans:", "floorplans:: expected a folder or a map file"),
        ("florplans:maps", "unknown set of settings 'florplans': choose one of .*cmu, .*floorplans"),
        ("plan.yaml?begin=1,2", "unknown parameter 'begin': choose from start, target, metres_per_pixel"),
        ("plan.yaml?start=1", "expected start=X,Y in metres, got '1'"),
        ("plan.yaml?start=1,2,3", "expected start=X,Y in metres"),
        ("plan.yaml?target=a,b", "expected target=X,Y in metres, got 'a,b'"),
        ("plan.yaml?start=nan,1", "expected start=X,Y"),
        ("plan.yaml?start=1e308,1", "expected start=X,Y"),
        ("plan.yaml?start=1,2&start=2,1", "parameter 'start' is given twice"),
        ("plan.yaml?start", "expected key=value"),
        ("plan.png?metres_per_pixel=0", "expected metres_per_pixel above 0, got 0"),
        ("plan.png?metres_per_pixel=wide", "expected metres_per_pixel=a number, got 'wide'"),
    ],
)
def test_mistakes_are_named(text: str, message: str) -> None:
    with pytest.raises(MapError, match=message):
        parse_spec(text)


numbers = st.floats(-1e4, 1e4)
positions = st.none() | st.tuples(numbers, numbers)


@given(positions, positions)
def test_places_of_the_command_line_come_back_exactly(start, target) -> None:
    for text in ("plan.yaml", "floorplans:plan.png?metres_per_pixel=0.1"):
        (spec,) = with_places([text], start, target)
        parsed = parse_spec(spec)
        assert (parsed.path, parsed.start, parsed.target) == (parse_spec(text).path, start, target)


def test_places_go_to_one_file(folder: Path) -> None:
    path = str(folder / "what?start=1,2.png")
    (spec,) = with_places([path], (3.0, 4.0), None)
    assert parse_spec(spec).start == (3.0, 4.0) and parse_spec(spec).path == Path(path)
    for specs, message in (
        (["a.png", "b.png"], "--start expect one map file, got a.png, b.png"),
        (["generator:rooms"], "--start expect one map file, got generator:rooms"),
        ([str(folder)], "--start expect one map file, got the folder"),
        (["a.png?start=1,2"], "specifies start itself: leave out one of the two"),
    ):
        with pytest.raises(MapError, match=message):
            with_places(specs, (1.0, 2.0), None)
