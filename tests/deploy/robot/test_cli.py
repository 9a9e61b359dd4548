import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from typer.testing import CliRunner

import actors.simulators
from common.errors import ConfigError
from deploy.cli import app
from deploy.config import DeployConfig, DrivingConfig
from deploy.profiles import load_deploy_config
from deploy.robot import defaults
from deploy.robot.cli import checked_options, placed, robot_config, suited_settings
from deploy.robot.options import RobotOptions
from deploy.robot.simulation import load_world
from deploy.robot.trial import robot_arguments
from tests.actors.maps.images import simple
from tests.actors.maps.ros_files import write_ros

runner = CliRunner()


@pytest.mark.parametrize("command", ["robot", "demo"])
def test_help_shows_examples(command):
    result = runner.invoke(app, [command, "--help"])
    assert result.exit_code == 0
    assert f"hd-deploy {command} --" in result.output


def test_the_robot_is_a_router_on_the_loopback_unless_it_joins_one():
    assert robot_config(DeployConfig(), None, None).ros.listen == ("tcp/127.0.0.1:7447",)
    joined = robot_config(DeployConfig(), ["tcp/10.0.0.5:7447"], None).ros
    assert (joined.connect, joined.listen) == (("tcp/10.0.0.5:7447",), ())
    with pytest.raises(ConfigError, match="one of the two"):
        robot_config(DeployConfig(), ["tcp/10.0.0.5:7447"], ["tcp/127.0.0.1:7448"])


def test_the_robot_is_where_the_bridges_own_settings_say():
    elsewhere = load_deploy_config(overrides=["ros.connect=tcp/127.0.0.1:7450"])
    assert robot_config(elsewhere, None, None).ros.listen == ("tcp/127.0.0.1:7450",)
    listening = load_deploy_config(overrides=["ros.listen=tcp/127.0.0.1:7451", "ros.connect="])
    joined = robot_config(listening, None, None).ros
    assert (joined.connect, joined.listen) == (("tcp/127.0.0.1:7451",), ())
    with pytest.raises(ConfigError, match=r"ros.connect names tcp/10.0.0.7:7447: .*--listen"):
        robot_config(load_deploy_config(overrides=["ros.connect=tcp/10.0.0.7:7447"]), None, None)


def test_a_wrong_option_is_named_as_it_was_written():
    with pytest.raises(ConfigError, match="--speed-factor: .*greater than 0, got -1"):
        checked_options({"speed_factor": -1})
    with pytest.raises(ConfigError, match="--layers: .*got 3"):
        checked_options({"layers": 3})


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--listen", "tcp/127.0.0.1:0", "--map", "generator:castle"], "no generator"),
        (["--listen", "tcp/127.0.0.1:0", "--map", "/nowhere"], "no such folder"),
        (["--profile", "spot"], "spot"),
        (["--listen", "carrier-pigeon"], "--listen: an endpoint must be tcp/HOST:PORT"),
    ],
)
def test_what_cannot_be_used_is_one_line_and_exit_code_1(options, words):
    pytest.importorskip("pybullet", reason="PyBullet is not installed")
    result = runner.invoke(app, ["robot", *options])
    assert result.exit_code == 1
    assert words in result.output


def test_without_pybullet_the_command_says_what_to_install(monkeypatch):
    for name in [name for name in sys.modules if name.startswith(("pybullet", "actors.simulators"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "pybullet", None)
    result = runner.invoke(app, ["robot", "--listen", "tcp/127.0.0.1:0"])
    assert result.exit_code == 1
    assert "needs the package pybullet, which is not installed:" in result.output


def test_defaults_of_the_command_are_those_of_the_options():
    assert checked_options({}) == RobotOptions()


def test_a_start_goes_into_the_map_and_a_set_into_the_settings(tmp_path):
    path = write_ros(tmp_path / "plan.yaml")
    world = placed(str(path), (1.5, 1.0), None)
    assert load_world(RobotOptions(map=world)).start == (1.5, 1.0)
    assert robot_arguments(RobotOptions(map=world)) == ["--map", f"{path}?start=1.5,1.0"]
    assert placed("generator:office", None, None) == "generator:office"
    assert "mapping.viewpoint_spacing=4.0" in suited_settings(world)
    assert suited_settings("generator:office") == []
    config = load_deploy_config(overrides=[*suited_settings(world), "mapping.viewpoint_spacing=2"])
    assert (config.mapping.resolution, config.mapping.viewpoint_spacing) == (0.1, 2.0)
    assert config.mapping.robot_radius == pytest.approx(0.3), "the body is the robot's, whatever its world"


def test_the_simulated_robot_is_as_large_as_the_bridge_takes_it_to_be():
    model = ElementTree.parse(Path(actors.simulators.__file__).parent / "robot.urdf")
    body = model.find("link/visual/geometry/cylinder")
    assert body is not None
    assert float(body.attrib["radius"]) == DrivingConfig().robot_radius


def test_the_scale_is_given_or_the_sets_or_the_robots_own(tmp_path):
    simple(tmp_path / "a.png")
    path = str(tmp_path / "a.png")
    assert load_world(RobotOptions(map=path)).resolution == defaults.METRES_PER_PIXEL
    assert load_world(RobotOptions(map=f"floorplans:{path}")).resolution == 0.1
    assert load_world(RobotOptions(map=f"floorplans:{path}", metres_per_pixel=0.3)).resolution == 0.3
    assert load_world(RobotOptions()).resolution == defaults.METRES_PER_PIXEL


def test_a_negative_start_is_an_option_with_two_values(tmp_path):
    pytest.importorskip("pybullet", reason="PyBullet is not installed")
    path = write_ros(tmp_path / "plan.yaml", origin=[-5.0, -5.0, 0.0])
    result = runner.invoke(app, ["robot", "--map", str(path), "--start", "-9.5", "-4"])
    assert result.exit_code == 1
    assert "the start (-9.50, -4.00) is outside the map" in result.output
    result = runner.invoke(app, ["demo", "--map", "generator:office", "--start", "1", "2"])
    assert result.exit_code == 1
    assert "--start expect one map file, got generator:office" in result.output
