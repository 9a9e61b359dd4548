from pathlib import Path

import numpy as np
import pytest

from actors.maps.sources import (
    GENERATED_WORLDS,
    FileSource,
    GeneratorSource,
    MapSource,
    fixed_set,
    in_validation,
    open_sources,
)
from common.config import MapsConfig
from common.errors import MapError
from tests.actors.maps.images import simple


def folder_of(path: Path, count: int) -> Path:
    path.mkdir()
    for number in range(count):
        simple(path / f"img_{number}.png")
    return path


def names(worlds: list) -> list[str]:
    return [world.name for world in worlds]


def test_a_folder_is_read_in_natural_order(tmp_path: Path) -> None:
    source = open_sources([str(folder_of(tmp_path / "maps", 12))], 0.25, "exploration")
    assert len(source) == 12 and source.name == str(tmp_path / "maps")
    assert source.world(2).name == "img_2.png" and source.world(13).name == "img_1.png"
    rng = np.random.default_rng(0)
    assert {source.draw(rng).name for _ in range(200)} == {f"img_{number}.png" for number in range(12)}
    assert source.world(0).resolution == 0.25


def test_train_and_validation_are_apart_and_complete(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "maps", 60)
    train, validation, whole = (
        open_sources([f"{folder}{split}"], 0.25, "navigation") for split in ("#train", "#validation", "")
    )
    parts = [names(fixed_set(source, 100)) for source in (train, validation)]
    assert not set(parts[0]) & set(parts[1])
    assert sorted(parts[0] + parts[1]) == sorted(names(fixed_set(whole, 100)))
    assert 0 < len(validation) < 20
    assert all(in_validation(name) for name in parts[1])
    # The split depends on names alone: other files change nothing.
    simple(folder / "other.png")
    again = open_sources([f"{folder}#validation"], 0.25, "navigation")
    assert set(parts[1]) <= set(names(fixed_set(again, 100)))


def test_about_a_tenth_is_validation() -> None:
    share = np.mean([in_validation(f"{number}.png") for number in range(5000)])
    assert 0.085 < share < 0.115


def test_generators_are_sources(tmp_path: Path) -> None:
    source: MapSource = open_sources(["generator:rooms?width=320&height=240"], 0.5, "navigation")
    assert len(source) == GENERATED_WORLDS
    world = source.world(3)
    assert world.size == (160.0, 120.0) and world.target is not None
    drawn = [source.draw(np.random.default_rng(5)).name for _ in range(2)]
    assert drawn[0] == drawn[1]


def test_default_training_and_validation_worlds_never_meet() -> None:
    config = MapsConfig()
    train, validation = (
        open_sources(specs, config.metres_per_pixel, "exploration") for specs in (config.train, config.validation)
    )
    assert isinstance(train, GeneratorSource) and isinstance(validation, GeneratorSource)
    assert train.generator.seed + len(train) <= validation.generator.seed


def test_a_mixture_draws_evenly_whatever_the_sizes(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "maps", 3)
    source = open_sources([str(folder), "generator:rooms?width=192&height=192"], 0.25, "navigation")
    rng = np.random.default_rng(1)
    from_folder = sum(source.draw(rng).name.startswith("img") for _ in range(300))
    assert 110 < from_folder < 190
    assert source.name.count(" + ") == 1
    assert [world.name.startswith("img") for world in (source.world(0), source.world(1))] == [True, False]
    chosen = names(fixed_set(source, 5))
    assert chosen[:3] == ["img_0.png", "img_1.png", "img_2.png"] and len(chosen) == 5
    assert chosen == names(fixed_set(source, 5))


def test_a_fixed_set_is_spread_over_the_folder(tmp_path: Path) -> None:
    source = open_sources([str(folder_of(tmp_path / "maps", 10))], 0.25, "exploration")
    assert names(fixed_set(source, 4)) == ["img_0.png", "img_2.png", "img_5.png", "img_7.png"]
    assert isinstance(source, FileSource) and len(fixed_set(source, 99)) == 10


def test_wrong_sources_say_what_to_do(tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    no_target = tmp_path / "maps"
    no_target.mkdir()
    simple(no_target / "a.png", target=False)
    (no_target / "a.txt").touch()
    single = tmp_path / "single"
    single.mkdir()
    in_train = next(f"{number}.png" for number in range(99) if not in_validation(f"{number}.png"))
    simple(single / in_train)
    for spec, task, message in (
        (str(tmp_path / "no"), "exploration", "no such folder: use a generator"),
        ("~nobody-of-that-name/maps", "exploration", "no such folder: use a generator"),
        (f"{'m' * 300}.png", "exploration", "no such folder: use a generator"),
        (str(no_target / "a.png"), "exploration", None),
        (str(no_target / "a.txt"), "exploration", "is a file, expected a map"),
        (f"{no_target / 'a.png'}#train", "exploration", "splits the maps of a folder, got one file"),
        (str(empty), "exploration", "holds no PNG maps"),
        (str(no_target), "navigation", "expected one target marker"),
        (f"{single}#test", "exploration", "unknown split 'test': choose #train or #validation"),
        (f"{single}#validation", "exploration", "no map of this folder falls into the split"),
        ("generator:office?", "exploration", None),
        ("generator:ofice", "exploration", "did you mean 'office'"),
        ("generator:", "exploration", "no generator ''; generators are: rooms"),
        ("generator:rooms?width", "exploration", "expected key=value"),
        ("generator:rooms?seed=1&seed=2", "exploration", "'seed' is given twice"),
    ):
        if message is None:
            open_sources([spec], 0.25, task)
            continue
        with pytest.raises(MapError, match=message):
            open_sources([spec], 0.25, task)
    with pytest.raises(MapError, match="no source of maps is given"):
        open_sources([], 0.25, "exploration")


def test_a_folder_may_carry_a_hash_in_its_name(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "site#3", 2)
    assert len(open_sources([str(folder)], 0.25, "exploration")) == 2
