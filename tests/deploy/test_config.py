"""Profiles, precedence and messages of a robot's parameters, and the page that documents them."""

import json
import tomllib
from pathlib import Path

import pytest

from common.config.describe import to_toml
from common.config.load import load_config
from common.errors import ConfigError
from deploy import profiles
from deploy.config import DeployConfig
from deploy.profiles import DEPLOY, documentation, load_deploy_config

PAGE = Path(__file__).parents[2] / "docs" / "deploy" / "parameters.md"


def test_a_planner_may_be_named_by_its_module_and_class():
    config = load_deploy_config(overrides=["decision.planner=my_robot.planners:Mine"])
    assert config.decision.planner == "my_robot.planners:Mine"


def test_the_page_of_parameters_is_current():
    assert PAGE.read_text("utf-8") == documentation(), "run `make docs`"


def test_every_parameter_is_documented():
    page = documentation()
    for path, field in DEPLOY.all_fields():
        assert field.description, path
        assert f"`{path}`" in page


@pytest.mark.parametrize("name", DEPLOY.preset_names())
def test_every_profile_is_valid_and_reads_back(name, tmp_path):
    config = load_deploy_config(profile=name)
    file = tmp_path / "robot.toml"
    file.write_text(to_toml(config))
    assert load_deploy_config(file) == config
    assert DEPLOY.resolve(json.loads(config.model_dump_json())) == config


def test_what_follows_from_others_does_so_in_a_printed_file_too(tmp_path):
    printed = load_deploy_config()
    file = tmp_path / "robot.toml"
    file.write_text(to_toml(printed, printed.left_out))
    config = load_deploy_config(file)
    assert config == printed
    # Set to their defaults they would mean something else: TF and ROS_DOMAIN_ID would no longer count.
    assert "sensor_offset" not in config.sensing.model_fields_set
    assert "domain" not in config.ros.model_fields_set
    text = file.read_text().replace("# robot_radius = 0.25", "robot_radius = 0.4")
    text = text.replace("sensor_range = 20.0", "sensor_range = 10.0")
    file.write_text(text.replace('namespace = ""', 'namespace = "a"'))
    config = load_deploy_config(file)
    assert (config.name, config.driving.robot_radius, config.mapping.robot_radius) == ("a", 0.4, pytest.approx(0.45))
    assert config.mapping.viewpoint_spacing == pytest.approx(2.0)


def test_setting_one_parameter_of_the_map_leaves_the_others():
    config = load_deploy_config(overrides=["mapping.beacon_range=6"])  # the profile `bare`
    assert (config.mapping.resolution, config.mapping.viewpoint_spacing) == (0.1, 4.0)


def test_the_graph_follows_from_sensor_and_body_unless_it_is_said():
    config = load_deploy_config(overrides=["mapping.sensor_range=10", "driving.robot_radius=0.4"])
    assert config.mapping.viewpoint_spacing == pytest.approx(2.0)
    assert config.mapping.robot_radius == pytest.approx(0.45)
    config = load_deploy_config(overrides=["mapping.viewpoint_spacing=1.5", "mapping.robot_radius=0.6"])
    assert (config.mapping.viewpoint_spacing, config.mapping.robot_radius) == (1.5, 0.6)


def test_a_graph_that_leads_where_the_robot_does_not_fit_is_refused():
    with pytest.raises(ConfigError, match=r"mapping.robot_radius \(0.1 m\) must not be below driving.robot_radius"):
        load_deploy_config(overrides=["mapping.robot_radius=0.1"])
    # A stack of its own drives: what room it needs is its own business.
    assert load_deploy_config(overrides=["mapping.robot_radius=0.1"], profile="nav2").mapping.robot_radius == 0.1


def test_later_sources_win_over_earlier_ones(tmp_path):
    file = tmp_path / "robot.toml"
    file.write_text("[decision]\nplanner = 'tare'\nrate = 3.0\n[topics]\nwaypoint = '/goal'\n")
    environment = {"HDROBOT_DECISION__RATE": "4", "HDROBOT_SAFETY__SPEED_LIMIT": "0.5", "HD_LEARNER__THREADS": "4"}
    config = load_deploy_config(file, ["safety.speed_limit=0.25"], environment, "cmu")
    assert config.decision.planner == "tare"
    assert config.decision.rate == 4.0
    assert config.safety.speed_limit == 0.25
    assert config.topics.waypoint == "/goal"
    assert config.topics.odometry == "/state_estimation"


def test_variables_of_a_robot_are_none_of_a_run():
    assert load_config(environment={"HDROBOT_DECISION__RATE": "4"}).name == "default"


def test_the_profile_is_bare_when_none_is_named():
    assert load_deploy_config() == load_deploy_config(profile="bare")
    assert load_deploy_config().driving.enabled


@pytest.mark.parametrize(
    ("override", "value"),
    [
        ("decision.goal=3.5,-2", (3.5, -2.0)),
        ("decision.goal=[3.5, -2]", (3.5, -2.0)),
        ("decision.goal=null", None),
        ("safety.geofence=[[0,0],[4,0],[4,4]]", ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0))),
        ('topics.remap={"/scan": "/front/scan"}', {"/scan": "/front/scan"}),
        ("ros.connect=tcp/[::1]:7447?rel=1", ("tcp/[::1]:7447?rel=1",)),
        ("topics.navigate_action=~/go", "~/go"),
        ("topics.scan=front/scan", "front/scan"),
        ("ros.namespace=/fleet/robot1/", "/fleet/robot1/"),
        ("ros.connect=tcp/10.0.0.1:7447,tcp/10.0.0.2:7447", ("tcp/10.0.0.1:7447", "tcp/10.0.0.2:7447")),
    ],
)
def test_command_line_values_are_read_as_the_parameter_wants_them(override, value, tmp_path):
    found = config = load_deploy_config(overrides=[override])
    for part in override.partition("=")[0].split("."):
        found = getattr(found, part)
    assert found == value
    file = tmp_path / "robot.toml"
    file.write_text(to_toml(config))
    assert load_deploy_config(file) == config


@pytest.mark.parametrize(
    ("overrides", "profile", "words"),
    [
        (["decision.planer=tare"], None, ["decision.planer", "did you mean 'decision.planner'"]),
        (["decision.rate=0"], None, ["decision.rate", "greater than 0", "--set"]),
        (["safety.geofence=[[0,0],[1,1]]"], None, ["safety.geofence", "fewer than 3 corners"]),
        (["safety.geofence=[[0,0],[2,2],[2,0],[0,2]]"], None, ["safety.geofence", "sides do not cross"]),
        (["safety.geofence=[[0,0],[0.3,0],[0.3,4]]"], None, ["geofence leaves no room", "0.3 m"]),
        (
            ["safety.geofence=[[0,0],[4,0],[4,4],[0,4]]", "decision.task=navigation", "decision.goal=9,2"],
            None,
            ["decision.goal must lie inside safety.geofence", "got (9, 2)"],
        ),
        (["ros.connect=tcp/127.0.0.1"], None, ["ros.connect", "must be tcp/HOST:PORT", "got 'tcp/127.0.0.1'"]),
        (["ros.listen=serial/x"], None, ["ros.listen", "udp/HOST:PORT", "unixsock-stream/PATH", "got 'serial/x'"]),
        (["ros.connect="], None, ["connect or listen needs an endpoint"]),
        (["ros.connect=tls/10.0.0.1:7447"], None, ["tls/10.0.0.1:7447 needs certificates: set tls_ca"]),
        (["decision.live_connect=udp/10.0.0.1:7447"], None, ["decision.live_connect", "must be tcp/HOST:PORT"]),
        (["decision.live_run=office"], None, ["decision.live_run needs decision.live_connect"]),
        (["topics.scan=/2d"], None, ["topics.scan", "letters, digits and _", "got '/2d'"]),
        (["topics.scan=~/scan"], None, ["topics.scan", "letters, digits and _", "got '~/scan'"]),
        (['topics.remap={"/scan": "/a b"}'], None, ["topics.remap", "letters, digits and _", "not '/a b'"]),
        (["ros.namespace=robot-1"], None, ["ros.namespace", "a namespace is made of", "got 'robot-1'"]),
        (["ros.node=a/b"], None, ["ros.node", "one word without slashes"]),
        (["sensing.height_min=2"], None, ["height_min", "must be below height_max"]),
        (["name=My Robot"], None, ["lower-case letters"]),
        (["xyzzy.plugh=1"], None, ["hd-deploy config --describe"]),
        ([], "husky", ["unknown profile 'husky'", "bare, cmu, nav2"]),
    ],
)
def test_a_wrong_parameter_is_explained(overrides, profile, words):
    with pytest.raises(ConfigError) as caught:
        load_deploy_config(None, overrides, {}, profile)
    for word in words:
        assert word in str(caught.value)


def test_viewpoints_are_as_far_apart_as_those_of_the_shipped_policies_by_default():
    mapping = DeployConfig().mapping
    assert (mapping.resolution, mapping.viewpoint_spacing, mapping.robot_radius) == (0.2, 4.0, pytest.approx(0.3))


@pytest.mark.parametrize("name", DEPLOY.preset_names())
def test_the_page_of_a_profile_names_its_topics(name):
    page = (PAGE.parent / f"{name}.md").read_text("utf-8")
    profile = tomllib.loads((Path(profiles.__file__).parent / f"{name}.toml").read_text("utf-8"))
    for topic in filter(None, profile.get("topics", {}).values()):
        assert topic.lstrip("/") in page
    assert f"Profile `{name}`" in page
    assert "```mermaid" in page
