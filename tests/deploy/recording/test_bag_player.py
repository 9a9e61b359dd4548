import json
import sys
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from common.system.extras import MissingPackageError
from deploy.cli import app
from deploy.recording.bag_player import BagPlayer, has_decisions
from deploy.recording.comparison import compare
from deploy.recording.reader import read_bag
from deploy.recording.viewer import Viewer
from tests.deploy.recording.world import SCAN, config, explore, recorded, status, write


@pytest.fixture(scope="module")
def settings():
    return config("decision.planner=greedy")


@pytest.fixture(scope="module")
def messages(settings):
    return explore(settings)


@pytest.fixture(scope="module")
def bag(messages, settings, tmp_path_factory):
    return write(tmp_path_factory.mktemp("bags") / "lab", messages, settings)


def replay(settings, messages, self_start=False):
    result = BagPlayer(settings, self_start).run(messages)
    return result, compare(result.recorded, result.decided, result.begin, settings.mapping.viewpoint_spacing / 2)


def test_the_same_planner_decides_the_same(settings, bag):
    result, comparison = replay(settings, read_bag(bag))
    assert len(comparison.differences) >= 8
    assert comparison.agreement >= 0.9, comparison.first
    assert result.map_statistics.integrated > 150
    assert len(result.seconds) >= 8


@pytest.mark.parametrize("step", [-3600.0, 1.7e9], ids=["an hour back", "from 1970"])
def test_a_clock_that_is_set_while_it_is_recorded_changes_nothing(settings, messages, step, caplog):
    begin = messages[0].time
    late = begin + 10_000_000_000
    stepped = [replace(one, time=one.time + round(step * 1e9)) if one.time > late else one for one in messages]
    result, comparison = replay(settings, stepped)
    assert "the clock of the recording steps by" in caplog.text
    assert comparison.agreement >= 0.8, comparison.first
    assert max(one.time for one in result.decided) - result.begin < 1000.0
    assert len(result.seconds) >= 8


def test_another_planner_decides_otherwise(messages):
    _, comparison = replay(config("decision.planner=nearest"), messages)
    assert comparison.agreement < 1.0
    assert comparison.first.recorded != comparison.first.replayed


def test_sensors_alone_are_enough_to_see_what_would_be_decided(settings, messages):
    sensors = [one for one in messages if one.topic in {"/scan", "/odom"}]
    assert not has_decisions({one.topic for one in sensors}, settings.topics, settings.ros.namespace)
    assert has_decisions({one.topic for one in messages}, settings.topics, settings.ros.namespace)
    result, comparison = replay(settings, sensors, self_start=True)
    assert comparison.differences == ()
    assert len([one for one in result.decided if one.waypoint is not None]) >= 5


def test_recorded_orders_are_followed(settings, messages):
    sensors = [one for one in messages if one.topic in {"/scan", "/odom"}]
    text = "std_msgs/msg/String"
    idle, _ = replay(settings, sensors)
    assert not [one for one in idle.decided if one.waypoint is not None]
    orders = [
        recorded("/hd/status", text, 3.05, status("running")),
        recorded("/hd/status", text, 6.0, status("paused")),
    ]
    result, _ = replay(settings, sorted([*sensors, *orders], key=lambda one: one.time))
    going = [one.time - result.begin for one in result.decided if one.waypoint is not None]
    assert 3.0 <= min(going) <= max(going) <= 6.2
    assert result.end[0] == "paused"


def test_an_exploration_that_was_left_for_a_target_by_command_is_left_in_the_replay_too(settings, messages):
    sensors = [one for one in messages if one.topic in {"/scan", "/odom"}]
    text = "std_msgs/msg/String"
    orders = [
        recorded("/hd/status", text, 3.05, status("running", task="exploration")),
        recorded("/hd/status", text, 6.0, status("running", task="navigation", target=[500.0, 0.0])),
        recorded("/hd/status", text, 9.0, status("running", task="exploration")),
    ]
    tasks = []
    player = BagPlayer(settings, False, lambda outcome, now: tasks.append(outcome.orders.task.name))
    player.run(sorted([*sensors, *orders], key=lambda one: one.time))
    changes = [task for task, before in zip(tasks, [None, *tasks], strict=False) if task != before]
    assert changes == ["exploration", "navigation", "exploration"]


def test_a_dead_sensor_is_a_fault_in_the_replay_too(settings, messages):
    begin = messages[0].time
    dead = [one for one in messages if one.topic != "/scan" or one.time - begin < 5e9]
    result, _ = replay(settings, dead)
    assert result.faults["sensor_stale"] > 100


def test_damaged_messages_are_passed_over(settings, messages):
    noise = [recorded_noise(one) for one in messages[50:60]]
    result, _ = replay(settings, sorted([*messages, *noise], key=lambda one: one.time))
    assert result.seconds


def recorded_noise(one):
    return type(one)("/scan", SCAN, one.time, b"\0\1\0\0noise")


def test_the_command_reports(bag):
    result = CliRunner().invoke(app, ["replay", str(bag), "--json"])
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert told["comparison"]["agreement"] >= 0.9
    assert told["topics"]["/scan"]["rate"] == pytest.approx(10.0, abs=0.5)
    assert told["replay"]["map"]["dropped"] == {}
    plain = CliRunner().invoke(app, ["replay", str(bag), "--planner", "nearest", "--min-agreement", "1.0"])
    assert plain.exit_code == 1
    assert "first difference after" in plain.output
    assert "agreement:" in plain.output


def test_the_command_checks_alone(bag):
    result = CliRunner().invoke(app, ["replay", str(bag), "--checks-only", "--set", "topics.scan=/lidar"])
    assert result.exit_code == 0, result.output
    assert "no message on /lidar" in result.output.replace("\n", " ")
    assert "agreement" not in result.output


def test_the_command_recovers(bag, tmp_path):
    result = CliRunner().invoke(app, ["recover", str(bag), str(tmp_path / "whole")])
    assert result.exit_code == 0, result.output
    assert list(read_bag(tmp_path / "whole")) == list(read_bag(bag))


def test_the_command_says_what_is_missing(tmp_path):
    result = CliRunner().invoke(app, ["replay", str(tmp_path / "nowhere")])
    assert result.exit_code == 1
    assert "no recording at" in result.output.replace("\n", " ")


def test_the_viewer_asks_for_its_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MissingPackageError, match=r"\[rerun\]"):
        Viewer()


def test_a_recording_cannot_make_a_replay_import_a_module(messages, settings, tmp_path):
    decision = settings.decision.model_copy(update={"planner": "foreign_code:Planner"})
    named = settings.model_copy(update={"decision": decision})
    bag = write(tmp_path / "foreign", messages, named)
    refused = CliRunner().invoke(app, ["replay", str(bag)])
    assert refused.exit_code == 1
    assert "names the planner 'foreign_code:Planner' (decision.planner), which is code" in refused.output
    # Named by the user it is looked for.
    looked_for = CliRunner().invoke(app, ["replay", str(bag), "--planner", "foreign_code:Planner"])
    assert "No module named 'foreign_code'" in looked_for.output
    assert CliRunner().invoke(app, ["replay", str(bag), "--planner", "greedy"]).exit_code == 0
