"""What a user of `hd-deploy relay` types and reads, with and without ROS 2."""

import importlib.util
import logging

import pytest
from typer.testing import CliRunner

from common.errors import ConfigError
from deploy.cli import app
from deploy.profiles import load_deploy_config
from deploy.relay.dds import domain_of
from deploy.relay.process import as_router
from deploy.ros2 import RosError
from tests.common.bus.processes import free_port


@pytest.fixture(autouse=True)
def _logging_as_before():
    """The command logs to the runner's standard error, which is closed afterwards."""
    root = logging.getLogger()
    handlers, level = root.handlers[:], root.level
    yield
    root.handlers[:], root.level = handlers, level


@pytest.fixture(autouse=True)
def _logging_as_before():
    """The command logs to the runner's standard error, which is closed afterwards."""
    root = logging.getLogger()
    handlers, level = root.handlers[:], root.level
    yield
    root.handlers[:], root.level = handlers, level


def run(*words):
    return CliRunner().invoke(app, ["relay", *words])


@pytest.mark.skipif(importlib.util.find_spec("rclpy") is not None, reason="rclpy is installed")
def test_without_rclpy_one_sentence_says_what_to_install():
    result = run()
    assert result.exit_code == 1
    assert "pip install -e '.[robot,ros2]'" in result.stderr
    assert "Traceback" not in result.stderr


def test_two_ways_to_be_on_the_network_are_one_too_many():
    result = run("--listen", "tcp/127.0.0.1:1", "--connect", "tcp/127.0.0.1:2")
    assert "give one" in result.stderr


def test_a_status_of_nobody_says_so():
    result = run("--status", "--set", f"ros.connect=tcp/127.0.0.1:{free_port()}")
    assert result.exit_code == 1
    assert "no relay 'robot-relay' answered" in result.stderr


def test_the_relay_listens_where_the_bridge_connects():
    config = as_router(load_deploy_config())
    assert (config.ros.listen, config.ros.connect) == (("tcp/127.0.0.1:7447",), ())
    # Where the bridge is the router itself, the relay is its guest.
    guest = as_router(load_deploy_config(overrides=["ros.listen=tcp/127.0.0.1:7450", "ros.connect="]))
    assert (guest.ros.listen, guest.ros.connect) == ((), ("tcp/127.0.0.1:7450",))
    with pytest.raises(ConfigError, match=r"names tcp/10\.0\.0\.7:7447: give"):
        as_router(load_deploy_config(overrides=["ros.connect=tcp/10.0.0.7:7447"]))


def test_the_domain_is_that_of_the_parameters_else_of_ros():
    assert domain_of(0, given=False, environment={"ROS_DOMAIN_ID": "42"}) == 42
    assert domain_of(7, given=True, environment={"ROS_DOMAIN_ID": "42"}) == 7
    assert domain_of(0, given=False, environment={}) == 0
    with pytest.raises(RosError, match="number from 0 to 232, got 'lab'"):
        domain_of(0, given=False, environment={"ROS_DOMAIN_ID": "lab"})
