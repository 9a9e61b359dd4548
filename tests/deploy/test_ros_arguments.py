"""Arguments and files of parameters as ROS 2 gives them to its nodes."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from common.errors import ConfigError
from deploy.profiles import load_deploy_config
from deploy.ros_arguments import translate

ROOT = Path(__file__).parents[2]


def resolved(*words):
    """The configuration that a command line with these arguments resolves to."""
    options = translate(words)
    return load_deploy_config(overrides=[each for each in options if "=" in each])


def test_names_remappings_and_parameters_are_settings():
    config = resolved(
        "--ros-args", "-r", "__ns:=/robot1", "-r", "__node:=explorer", "--remap", "/scan:=/front/scan", "-r", "odom:=o",
        "-p", "decision.planner:=tare", "-p", "use_sim_time:=true", "--enable-rosout-logs",
    )  # fmt: skip
    assert (config.ros.namespace, config.ros.node, config.name) == ("/robot1", "explorer", "robot1")
    assert config.topics.remap == {"/scan": "/front/scan", "odom": "o"}
    assert config.decision.planner == "tare"


def test_what_stands_around_them_stays():
    words = ["bridge", "--ros-args", "--log-level", "rcl:=DEBUG", "--", "--autostart"]
    assert translate(words) == ["bridge", "--log-level", "debug", "--autostart"]
    assert translate(["bridge", "--profile", "cmu"]) == ["bridge", "--profile", "cmu"]


def test_a_file_of_parameters(tmp_path):
    file = tmp_path / "robot.yaml"
    file.write_text(
        "/**:\n  ros__parameters:\n    use_sim_time: false\n    decision: {planner: tour, goal: [7.5, 2.0]}\n"
        "    driving.enabled: true\n    safety.geofence: [[0, 0], [9, 0], [9, 9]]\n"
        "    topics: {remap: {/scan: /front}, joy: ''}\n",
        encoding="utf-8",
    )
    config = resolved("--ros-args", "--params-file", str(file))
    assert (config.decision.planner, config.decision.goal, config.driving.enabled) == ("tour", (7.5, 2.0), True)
    assert config.safety.geofence == ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0))
    assert (config.topics.remap, config.topics.joy) == ({"/scan": "/front"}, "")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-r", "scan"], "takes NAME:=VALUE"),
        (["-e", "enclave"], "no argument of ROS 2 that is known"),
        (["-p"], "no argument of ROS 2"),
        (["--params-file", "/nowhere.yaml"], "cannot read the parameters in /nowhere.yaml"),
    ],
)
def test_what_cannot_be_meant_is_refused(words, message):
    with pytest.raises(ConfigError, match=message):
        translate(["bridge", "--ros-args", *words])


@pytest.mark.parametrize("text", ["a: 1", "[1]", "a: {ros__parameters: 3}", "{", "/**:\n  planner: x"])
def test_a_file_that_holds_no_parameters_is_refused(tmp_path, text):
    file = tmp_path / "robot.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=r"robot\.yaml"):
        translate(["--ros-args", "--params-file", str(file)])


def test_the_command_itself_understands_them():
    command = [sys.executable, "-m", "deploy", "config", "--ros-args", "-r", "__ns:=/robot1", "-p", "ros.domain:=7"]
    result = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=100)
    assert result.returncode == 0, result.stderr
    assert tomllib.loads(result.stdout)["ros"]["domain"] == 7
    broken = subprocess.run([*command, "-p", "ros.domain"], capture_output=True, text=True, cwd=ROOT, timeout=100)
    assert broken.returncode == 1
    assert broken.stderr.startswith("error: -p takes NAME:=VALUE")
