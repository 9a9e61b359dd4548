import pytest

from actors.evaluation.worlds import WorldSet
from common.errors import MapError
from tests.actors.evaluation.small import MAPS
from tests.actors.maps.images import simple


def test_equal_file_names_are_told_apart_by_their_folders(tmp_path):
    for folder in ("easy", "hard"):
        (tmp_path / folder).mkdir()
        for number in (1, 2, 10):
            simple(tmp_path / folder / f"img_{number}.png")
    worlds = WorldSet.open([str(tmp_path)], "exploration", 0.25, None)
    assert [worlds.name(number) for number in worlds.numbers] == [
        "easy/img_1.png", "easy/img_2.png", "easy/img_10.png", "hard/img_1.png", "hard/img_2.png", "hard/img_10.png",
    ]  # fmt: skip
    assert worlds.find(["hard/img_2.png"]) == {"hard/img_2.png": 4}
    few = WorldSet.open([str(tmp_path)], "exploration", 0.25, 2)
    assert [few.name(number) for number in few.numbers] == ["easy/img_1.png", "hard/img_1.png"]
    alone = WorldSet.open([str(tmp_path / "easy")], "exploration", 0.25, None)
    assert alone.name(0) == "img_1.png"
    with pytest.raises(MapError, match="--maps"):
        alone.find(["img_7.png"])


def test_a_world_that_is_given_twice_is_an_error(tmp_path):
    """It was found out when all had been driven, and results could not be written."""
    simple(tmp_path / "a.png")
    for specs in ([MAPS, MAPS], [MAPS, f"{MAPS}&seed=1"], [str(tmp_path), str(tmp_path / "a.png")]):
        with pytest.raises(MapError, match="more than once: leave one source out"):
            WorldSet.open(specs, "exploration", 0.25, 6)
    assert len(WorldSet.open([MAPS, f"{MAPS}&seed=3"], "exploration", 0.25, 6)) == 6


def test_generated_worlds_have_numbers_and_names():
    worlds = WorldSet.open([MAPS], "exploration", 0.25, 3)
    assert len(worlds) == 3
    assert worlds.name(2) == worlds.load(2).name
    assert len(WorldSet.open([MAPS], "exploration", 0.25, None)) == 100
