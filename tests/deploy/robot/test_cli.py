import sys

import pytest
from typer.testing import CliRunner

from common.errors import ConfigError
from deploy.cli import app
from deploy.config import DeployConfig
from deploy.robot.cli import ENDPOINT, checked_options, robot_config
from deploy.robot.options import RobotOptions

runner = CliRunner()


@pytest.mark.parametrize("command", ["robot", "demo"])
def test_help_shows_examples(command):
    result = runner.invoke(app, [command, "--help"])
    assert result.exit_code == 0
    assert f"hd-deploy {command} --" in result.output


def test_the_robot_is_a_router_on_the_loopback_unless_it_joins_one():
    assert robot_config(DeployConfig(), None, None).ros.listen == (ENDPOINT,)
    joined = robot_config(DeployConfig(), ["tcp/10.0.0.5:7447"], None).ros
    assert (joined.connect, joined.listen) == (("tcp/10.0.0.5:7447",), ())
    with pytest.raises(ConfigError, match="one of the two"):
        robot_config(DeployConfig(), ["tcp/10.0.0.5:7447"], ["tcp/127.0.0.1:7448"])


def test_a_wrong_option_is_named_as_it_was_written():
    with pytest.raises(ConfigError, match="--speed-factor: .*greater than 0, got -1"):
        checked_options({"speed_factor": -1})
    with pytest.raises(ConfigError, match="--layers: .*got 3"):
        checked_options({"layers": 3})


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--map", "generator:castle"], "unknown generator"),
        (["--map", "/nowhere"], "no such folder"),
        (["--profile", "spot"], "spot"),
        (["--listen", "carrier-pigeon"], "carrier-pigeon"),
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
    result = runner.invoke(app, ["robot"])
    assert result.exit_code == 1
    assert "needs PyBullet, which is not installed: pip install" in result.output


def test_defaults_of_the_command_are_those_of_the_options():
    assert checked_options({}) == RobotOptions()
