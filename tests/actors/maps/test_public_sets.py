"""The public sets of maps, and folders that should hold one."""

import dataclasses
import re

import pytest
from typer.testing import CliRunner

from actors.evaluation.cli import app
from actors.maps.generators import make_generator
from actors.maps.png import write_png
from actors.maps.public_sets import PUBLIC_SETS, check_folder
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
    assert len(found.problems) == 2


def test_what_is_not_there_says_how_to_get_it(tmp_path):
    with pytest.raises(MapError, match="git clone"):
        check_folder(SMALL, tmp_path / "nowhere")
    result = runner.invoke(app, ["maps", "dungeons"])
    assert result.exit_code == 1
    assert "there is no public set 'dungeons'" in result.output
