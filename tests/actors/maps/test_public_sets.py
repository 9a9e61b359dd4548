"""The public sets of maps, and folders that should hold one."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from actors.evaluation.cli import app
from actors.maps.generators import make_generator
from actors.maps.png import write_png
from actors.maps.public_sets import PUBLIC_SETS, check_folder
from actors.maps.recommended import read_preset
from common.errors import MapError

runner = CliRunner()
SMALL = dataclasses.replace(PUBLIC_SETS["exploration-easy"], count=2)


@pytest.fixture
def folder(tmp_path):
    """Return a folder of two maps without targets."""
    for number in range(2):
        world = make_generator("rooms", {"width": "192", "height": "192"}).world(number, 0.25)
        write_png(dataclasses.replace(world, target=None, target_region=None), tmp_path / f"{number}.png")
    return tmp_path


def test_every_set_is_listed_with_the_way_to_it():
    result = runner.invoke(app, ["maps"])
    assert result.exit_code == 0
    for each in PUBLIC_SETS.values():
        line = re.search(rf"^{each.name} .*$", result.output, re.M)
        assert line and each.folder in line[0] and "git clone" in line[0] and each.licence in line[0]


@pytest.mark.parametrize("name", ["floorplans", "cmu"])
def test_a_set_of_pictures_says_how_to_prepare_it_and_which_settings_suit_it(name):
    result = runner.invoke(app, ["maps", name])
    assert result.exit_code == 0
    fetch, prepare, use = result.output.splitlines()
    assert fetch.startswith("git clone") and "yellow" in prepare
    assert use.startswith(f"use: --maps {name}:FOLDER (")
    for path, value in read_preset(name).settings.items():
        assert f"{path}={value}" in use


def test_plans_are_checked_with_the_scale_and_the_starts_that_an_evaluation_takes(folder):
    """The start (4, 4) m is inside the picture at the preset's 0.1 m a pixel, outside at the scale of worlds.toml."""
    for file in folder.glob("*.png"):
        plain = np.full((100, 200, 3), 255, np.uint8)
        Image.fromarray(plain).save(file)
    plans = PUBLIC_SETS["floorplans"]
    assert len(check_folder(plans, folder).problems) == 2
    starts = "".join(f'[worlds."{number}.png"]\nstart = [4.0, 4.0]\n' for number in range(2))
    (folder / "worlds.toml").write_text("[maps]\nmetres_per_pixel = 0.01\n" + starts)
    assert check_folder(plans, folder).problems == ()


@pytest.mark.parametrize("name", [pytest.param("floorplans", marks=pytest.mark.slow), "cmu"])
def test_the_prepared_public_plans_are_such_sets(name):
    maps = Path(__file__).parents[4] / "shared" / "data" / "maps" / name
    if not maps.is_dir():
        pytest.skip("the public maps are not here (../shared/data)")
    assert check_folder(PUBLIC_SETS[name], maps).problems == ()


def test_a_sound_folder_has_no_problems(folder):
    found = check_folder(SMALL, folder)
    assert (found.maps, found.problems) == (2, ())


def test_a_map_too_few_and_a_damaged_one_are_named(folder):
    (folder / "1.png").write_bytes(b"no picture")
    found = check_folder(dataclasses.replace(SMALL, count=3), folder)
    assert found.problems[0] == "expected 3 maps, got 2: fetch it again"
    assert "1.png" in found.problems[1]
    result = runner.invoke(app, ["maps", "exploration-easy", str(folder)])
    assert result.exit_code == 1
    assert "2 maps, 2 problems" in result.output


def test_maps_without_a_target_are_no_set_for_navigation(folder):
    found = check_folder(PUBLIC_SETS["navigation-test"], folder)
    assert sum(".png" in problem for problem in found.problems) == 2


def test_what_is_not_there_says_how_to_get_it(tmp_path):
    with pytest.raises(MapError, match="git clone"):
        check_folder(SMALL, tmp_path / "nowhere")
    result = runner.invoke(app, ["maps", "dungeons"])
    assert result.exit_code == 1
    assert "unknown set 'dungeons'" in result.output
