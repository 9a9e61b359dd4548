import time
from pathlib import Path

import pytest

from actors.maps.recommended import Recommendation, as_tree, joined, preset_names, read_folder, read_preset
from actors.maps.sources import open_sources, recommended
from common.errors import ConfigError, MapError
from common.extensions import GENERATORS
from tests.actors.maps.images import paint, simple
from tests.actors.maps.ros_files import write_ros

SETTINGS = """
[maps]
metres_per_pixel = 0.1
[mapping]
resolution = 0.1
sensor_range = 15
viewpoint_spacing = 2.0
robot_radius = 0.3
[task]
max_steps = 700
unseen_area = 2
[simulator]
sense_every = 0.5
[worlds."b.jpg"]
start = [2.0, 4.0]
"""


def test_a_folder_says_what_suits_its_maps(tmp_path: Path) -> None:
    (tmp_path / "worlds.toml").write_text("\ufeff" + SETTINGS)
    simple(tmp_path / "a.png")
    paint(tmp_path / "b.png", [(16, 16, 80, 32)], [])
    (tmp_path / "b.png").rename(tmp_path / "b.jpg")
    suits = recommended(str(tmp_path))
    assert suits.metres_per_pixel == 0.1 and suits.settings["mapping.sensor_range"] == 15.0
    assert as_tree(suits.settings)["task"] == {"max_steps": 700, "unseen_area": 2.0}
    source = open_sources([str(tmp_path)], None, "exploration")
    assert [source.world(index).name for index in range(2)] == ["a.png", "b.jpg"]
    assert source.scales == {0.1} and source.world(1).start == (2.0, 4.0)
    # One file of the folder has the same settings and place.
    assert recommended(str(tmp_path / "a.png")).settings == suits.settings
    assert open_sources([str(tmp_path / "b.jpg")], None, "exploration").world(0).start == (2.0, 4.0)
    # What is given wins: for the whole run, and for one source.
    assert open_sources([str(tmp_path)], 0.5, "exploration").scales == {0.5}
    assert open_sources([f"{tmp_path}?metres_per_pixel=0.2"], 0.5, "exploration").scales == {0.2}
    world = open_sources([f"{tmp_path / 'b.jpg'}?start=3,4"], None, "exploration").world(0)
    assert (world.start, world.name) == ((3.0, 4.0), "b.jpg?start=3.0,4.0")


def test_a_preset_goes_over_the_file_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "worlds.toml").write_text("[maps]\nmetres_per_pixel = 0.5\n[simulator]\nsense_every = 1.0\n")
    simple(tmp_path / "a.png")
    suits = recommended(f"floorplans:{tmp_path}")
    assert suits.metres_per_pixel == 0.1 and suits.settings["simulator.sense_every"] == 1.0
    assert open_sources([f"floorplans:{tmp_path}"], None, "exploration").scales == {0.1}
    assert open_sources([f"cmu:{tmp_path / 'a.png'}"], None, "exploration").scales == {0.25}
    assert recommended(str(tmp_path)).metres_per_pixel == 0.5


def test_shipped_presets_are_sound_and_known_ones_are_there() -> None:
    names = preset_names()
    assert {"floorplans", "cmu", "office", "warehouse", "tunnel", "forest", "hall", "building"} <= set(names)
    assert all(read_preset(name).settings for name in names)
    floorplans = read_preset("floorplans").settings
    assert floorplans["mapping.robot_radius"] == 0.25 and floorplans["task.unseen_area"] == 5.0
    # Those that bear a generator's name say nothing of its scale or of what the robot is.
    assert all(set(read_preset(name).settings) == {"task.max_steps"} for name in GENERATORS.shipped if name in names)


def test_generators_take_the_preset_of_their_name() -> None:
    assert recommended("generator:office?seed=3").settings == {"task.max_steps": "auto"}
    assert recommended("generator:rooms").settings == {}


def test_ros_maps_count_as_floor_plans_of_their_own_scale(tmp_path: Path) -> None:
    path = write_ros(tmp_path / "plan.yaml")
    without_scale = read_preset("floorplans").without("maps.metres_per_pixel").settings
    assert recommended(f"{path}?start=1.5,1.0").settings == without_scale
    assert recommended(f"floorplans:{path}?start=1.5,1.0").settings == without_scale
    assert open_sources([f"{path}?start=1.5,1.0"], 0.25, "exploration").scales == {0.05}
    (tmp_path / "worlds.toml").write_text('[mapping]\nresolution = 0.2\n[worlds."plan.yaml"]\nstart = [1.5, 1.0]\n')
    assert recommended(str(tmp_path)).settings == {"mapping.resolution": 0.2}
    assert open_sources([str(tmp_path)], None, "exploration").world(0).start == (1.5, 1.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[mapping", "expected settings of worlds in TOML"),
        ("resolution = 1", r"worlds\.toml: resolution: expected tables such as .*, got a value, 1"),
        ("[mapping]\nresolutoin = 0.1", "unknown setting: did you mean 'mapping.resolution'"),
        ("[mapping]\nresolution = 'fine'", "mapping.resolution: input should be a valid number.*got 'fine'"),
        ("[mapping]\nviewpoint_spacing = 0.3", "viewpoint_spacing .* must be at least two belief cells"),
        (
            "[learner]\nbatch_size = 3",
            r"learner\.batch_size is no setting of worlds: choose from maps\.metres_per_pixel",
        ),
        ("[task]\nname = 'navigation'", r"task\.name is no setting of worlds"),
        ("[task]\nmax_steps = 'many'", r"task\.max_steps: input should be a valid integer"),
        (
            "[worlds.'a.png']\nstart = [1.0]",
            r'worlds\."a\.png"\.start: expected \[x, y\], two numbers in metres, got \[1\.0\]',
        ),
        ("[worlds.'a.png']\nstart = 'door'", r'worlds\."a\.png"\.start: expected .*, got \'door\''),
        ("[worlds.'a.png']\nbegin = [1.0, 2.0]", r'worlds\."a\.png"\.begin: unknown key, expected start or target'),
        ("[worlds.'a.png']\nstart = [nan, 2.0]", r'worlds\."a\.png"\.start: expected .*, got \[nan, 2\.0\]'),
        (
            "[worlds.'b.png']\nstart = [1.0, 2.0]",
            r'worlds\."b\.png": .* no file \'b\.png\' .*: did you mean \'a\.png\'\?',
        ),
        ("[worlds]\n'a.png' = [1.0, 2.0]", r'worlds\."a\.png": expected tables such as'),
        ("worlds = 3", "worlds: expected tables such as"),
    ],
)
def test_wrong_settings_are_one_sentence(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "worlds.toml").write_text(text)
    simple(tmp_path / "a.png")
    with pytest.raises(MapError, match=message) as raised:
        recommended(str(tmp_path / "a.png"))
    assert "\n" not in str(raised.value) and "worlds.toml" in str(raised.value)


def test_files_that_cannot_be_settings(tmp_path: Path) -> None:
    (tmp_path / "worlds.toml").write_bytes("# größer".encode("latin-1"))
    with pytest.raises(MapError, match="cannot read the settings of these worlds"):
        read_folder(tmp_path)
    assert read_folder(tmp_path / "nowhere") == Recommendation()


def test_sources_that_need_different_settings_are_told_apart() -> None:
    fine = Recommendation("fine", {"maps.metres_per_pixel": 0.1, "mapping.resolution": 0.1, "task.max_steps": 300})
    coarse = Recommendation("coarse", {"maps.metres_per_pixel": 0.2, "mapping.resolution": 0.2, "task.max_steps": 500})
    with pytest.raises(ConfigError, match=r"mapping\.resolution \(fine: 0\.1, coarse: 0\.2\).*--set mapping"):
        joined([fine, coarse], [])
    with pytest.raises(ConfigError, match="a source without settings: None"):
        joined([fine, Recommendation()], [])
    assert joined([fine, coarse], ["mapping.resolution"]) == {"task.max_steps": 500}
    assert joined([fine, Recommendation()], ["mapping.resolution"]) == {"task.max_steps": 300}
    assert joined([fine, fine], []) == fine.settings
    auto = Recommendation("auto", {"task.max_steps": "auto"})
    assert joined([fine, auto], ["mapping.resolution"]) == {"task.max_steps": "auto"}


@pytest.mark.parametrize("text", ["a" + ".a" * 60_000 + " = 1", "a = " + "[" * 60_000])
def test_settings_that_are_made_to_cost_are_refused_at_once(tmp_path, text):
    (tmp_path / "worlds.toml").write_text(text)
    began = time.process_time()
    with pytest.raises(MapError, match="must not nest deeper"):
        read_folder(tmp_path)
    assert time.process_time() - began < 1.0
