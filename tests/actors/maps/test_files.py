from pathlib import Path

import pytest

from actors.maps.files import list_maps
from actors.maps.recommended import Places
from common.errors import MapError
from tests.actors.maps.ros_files import write_ros


def listed(folder: Path, places: dict | None = None) -> list[str]:
    return [file.path.relative_to(folder).as_posix() for file in list_maps(folder, places)]


def test_files_are_listed_in_natural_order(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    for name in ("img_10.png", "img_2.png", "img_1.PNG", "notes.txt", "sub/3.png", ".hidden.png", "preview.jpg"):
        (tmp_path / name).touch()
    assert listed(tmp_path) == ["img_1.PNG", "img_2.png", "img_10.png", "sub/3.png"]


def test_ros_maps_stand_for_their_images(tmp_path: Path) -> None:
    write_ros(tmp_path / "floor_10.yaml", image="floor_10.png")
    write_ros(tmp_path / "floor_2.yml", image="floor_2.pgm")
    (tmp_path / "other.png").touch()
    (tmp_path / "nav2_params.yaml").write_text("amcl:\n  ros__parameters: {}\n")
    (tmp_path / "broken.yaml").write_text("a: [")
    assert listed(tmp_path) == ["floor_2.yml", "floor_10.yaml", "other.png"]


def test_places_make_maps_of_other_images(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").touch()
    (tmp_path / "b.png").touch()
    places = {"a.jpg": Places(start=(1.0, 2.0)), "b.png": Places(target=(3.0, 4.0))}
    first, second = list_maps(tmp_path, places)
    assert (first.path.name, first.start, first.target) == ("a.jpg", (1.0, 2.0), None)
    assert (second.path.name, second.start, second.target) == ("b.png", None, (3.0, 4.0))
    with pytest.raises(MapError, match=r"there is no map 'c\.png' in this folder"):
        list_maps(tmp_path, {"c.png": Places()})


def test_settings_of_a_subfolder_are_not_passed_over(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "worlds.toml").touch()
    (tmp_path / "a.png").touch()
    with pytest.raises(MapError, match=r"sub/worlds\.toml applies only to its own folder: give that folder"):
        list_maps(tmp_path)
