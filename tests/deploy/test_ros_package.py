"""The files of the ROS 2 package fit the bridge: parameters, topics, QoS and versions."""

import ast
import json
import re
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import pytest
from ruamel.yaml import YAML

from deploy.cli import app
from deploy.profiles import DEPLOY, load_deploy_config
from deploy.ros_arguments import parameters_of
from deploy.routes import Direction, routes_of

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "ros2"


def routes(profile="bare", *overrides):
    return {route.topic: route for route in routes_of(load_deploy_config(overrides=overrides, profile=profile))}


@pytest.mark.parametrize("profile", DEPLOY.preset_names())
def test_parameters_resolve_on_their_profile(profile):
    config = load_deploy_config(overrides=parameters_of(PACKAGE / "config" / f"{profile}.yaml"), profile=profile)
    assert config.decision.planner == "hdplanner"
    assert routes_of(config)


def test_every_message_package_that_is_spoken_is_a_dependency():
    manifest = ElementTree.parse(PACKAGE / "package.xml").getroot()
    depends = {each.text for each in manifest.findall("exec_depend")}
    spoken = {route.kind.split("/")[0] for profile in DEPLOY.preset_names() for route in routes(profile).values()}
    assert spoken | {"lifecycle_msgs", "rclpy"} <= depends
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert manifest.find("version").text == project["version"]
    assert f'version="{project["version"]}"' in (PACKAGE / "setup.py").read_text("utf-8")


def test_rviz_shows_topics_that_exist_as_they_are_published():
    view = YAML(typ="safe").load((PACKAGE / "rviz" / "hdplanner.rviz").read_text("utf-8"))["Visualization Manager"]
    known = routes("nav2", "topics.scan=/scan")
    for display in view["Displays"]:
        topic = display.get("Topic")
        if topic is None:
            continue
        route = known[topic["Value"]]
        if topic["Durability Policy"] == "Transient Local":
            assert route.qos.transient_local, display
        assert topic["Reliability Policy"] == "Best Effort" or route.qos.reliable, display
    for tool in view["Tools"]:
        if "Topic" in tool:
            assert known[tool["Topic"]["Value"]].direction is Direction.TO_BRIDGE


def test_foxglove_shows_topics_that_exist():
    text = (PACKAGE / "foxglove" / "hdplanner.json").read_text("utf-8")
    panels = json.loads(text)["configById"]
    topics = set(re.findall(r'"(/[a-z_/]+)[".]', text))
    known = routes("nav2", "topics.scan=/scan", "topics.goal_pose=/hd/goal_pose")
    assert topics <= known.keys()
    for panel in panels.values():
        if "datatype" in panel:
            assert known[panel["topicName"]].kind == panel["datatype"]
            assert known[panel["topicName"]].direction is Direction.TO_BRIDGE


def test_the_launch_file_gives_options_that_the_commands_have():
    tree = ast.parse((PACKAGE / "launch" / "explore.launch.py").read_text("utf-8"))
    options = {
        node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and str(node.value).startswith("--")
    }
    assert options == {"--profile", "--listen", "--connect", "--log-level"}
    commands = {command.callback.__name__: command.callback for command in app.registered_commands}
    for name, expected in (("relay", {"profile", "listen", "log_level"}), ("bridge", {"profile", "connect"})):
        assert expected <= set(commands[name].__wrapped__.__annotations__)
