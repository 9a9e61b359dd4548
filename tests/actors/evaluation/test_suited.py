from pathlib import Path

import pytest

from actors.evaluation.resolving import resolve
from actors.evaluation.worlds import WorldSet
from common.errors import ConfigError, MapError
from tests.actors.maps.images import paint, simple
from tests.actors.maps.ros_files import write_ros


def test_settings_of_a_set_hold_unless_somebody_says_otherwise(tmp_path: Path, monkeypatch) -> None:
    simple(tmp_path / "a.png")
    told: list[str] = []
    settings = resolve([f"floorplans:{tmp_path}"], None, None, None, tell=told.append)
    assert (settings.metres_per_pixel, settings.mapping.resolution, settings.mapping.robot_radius) == (0.1, 0.1, 0.25)
    assert (settings.task.unseen_area, settings.task.max_steps) == (5.0, 128)
    assert len(told) == 1 and told[0].startswith(
        "settings of floorplans: maps.metres_per_pixel=0.1 mapping.resolution=0.1 "
    )
    file = tmp_path / "run.toml"
    file.write_text("[mapping]\nresolution = 0.2\n")
    monkeypatch.setenv("HD_TASK__UNSEEN_AREA", "3")
    settings = resolve([f"floorplans:{tmp_path}"], None, file, ["task.max_steps=77", "maps.metres_per_pixel=0.15"])
    assert (settings.mapping.resolution, settings.task.unseen_area, settings.task.max_steps) == (0.2, 3.0, 77)
    assert settings.metres_per_pixel == 0.15 and settings.mapping.robot_radius == 0.25


@pytest.mark.parametrize(("value", "words"), [({"seed": -1}, "seed: .*equal to 0, got -1"), ({"limit": 0}, "limit: ")])
def test_a_value_out_of_range_is_an_error_of_one_line(value: dict[str, int], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        resolve(["generator:rooms"], **{"limit": 1, "config": None, "overrides": None, **value})


def test_sources_without_a_set_are_as_they_were(tmp_path: Path) -> None:
    simple(tmp_path / "a.png")
    told: list[str] = []
    settings = resolve([str(tmp_path)], None, None, None, tell=told.append)
    assert (settings.metres_per_pixel, settings.mapping.resolution, settings.task.max_steps) == (0.25, 0.25, 128)
    assert told == []


def test_generators_get_an_ample_limit_whatever_the_number_of_worlds() -> None:
    limits = {resolve(["generator:office"], limit, None, None).task.max_steps for limit in (1, 3, None)}
    assert len(limits) == 1 and 500 < limits.pop() < 2000
    assert resolve(["generator:office"], 1, None, ["task.max_steps=9"]).task.max_steps == 9
    assert resolve(["generator:rooms"], 1, None, None).task.max_steps == 128


def test_a_start_on_the_command_line_names_the_world(tmp_path: Path) -> None:
    path = write_ros(tmp_path / "plan.yaml")
    settings = resolve([str(path)], None, None, None, start=(1.5, 1.0), target=(2.0, 1.2), task="navigation")
    assert settings.maps == (f"{path}?start=1.5,1.0&target=2.0,1.2",)
    assert (settings.metres_per_pixel, settings.mapping.resolution) == (0.05, 0.1)
    worlds = WorldSet.open(settings.maps, "navigation", settings.metres_per_pixel, None)
    assert worlds.name(0) == worlds.load(0).name == "plan.yaml?start=1.5,1.0&target=2.0,1.2"
    assert worlds.load(0).target == (2.0, 1.2)


def test_two_starts_in_one_file_are_two_worlds(tmp_path: Path) -> None:
    path = write_ros(tmp_path / "plan.yaml")
    worlds = WorldSet.open([f"{path}?start=1.5,1.0", f"{path}?start=2.0,1.0"], "exploration", None, None)
    assert [worlds.name(number) for number in worlds.numbers] == ["plan.yaml?start=1.5,1.0", "plan.yaml?start=2.0,1.0"]
    assert worlds.metres_per_pixel == 0.05


def test_worlds_of_two_scales_are_refused(tmp_path: Path) -> None:
    simple(tmp_path / "a.png")
    path = write_ros(tmp_path / "plan.yaml", image="b.png")
    with pytest.raises(MapError, match=r"expected worlds of one scale, got 0\.05, 0\.25 metres per cell"):
        WorldSet.open([str(tmp_path / "a.png"), f"{path}?start=1.5,1.0"], "exploration", None, None)
    with pytest.raises(ConfigError, match=r"these sources need different settings of mapping\.resolution"):
        resolve([str(tmp_path / "a.png"), f"{path}?start=1.5,1.0"], None, None, None)


def test_a_plain_image_needs_a_start(tmp_path: Path) -> None:
    path = paint(tmp_path / "a.pgm", [(16, 16, 80, 32)], [])
    with pytest.raises(MapError, match="expected one start marker .* --start X Y"):
        resolve([str(path)], None, None, None)
    assert resolve([str(path)], None, None, None, start=(5.0, 10.0)).maps == (f"{path}?start=5.0,10.0",)
