"""What a user of `hd-deploy` types and reads."""

import json
import signal
import socket
import subprocess
import sys
import threading
import time
import tomllib

import pytest
from typer.testing import CliRunner

from common.bus.liveness import declare_presence
from common.config.describe import to_toml
from deploy.bridge.bridge import Bridge
from deploy.cli import app
from tests.common.bus.processes import ROOT, eventually, free_port
from tests.common.planners.worlds import DEAD_END
from tests.deploy.bridge.robots import FakeRobot, network

MAPPING = {"resolution": 0.25, "viewpoint_spacing": 2.0, "sensor_range": 10.0, "beacon_range": 10.0}


def run(*words):
    return CliRunner().invoke(app, list(words))


def test_config_prints_what_it_reads(tmp_path):
    result = run("config", "--profile", "cmu", "--set", "decision.planner=tare")
    assert result.exit_code == 0
    tree = tomllib.loads(result.stdout)
    assert (tree["topics"]["waypoint"], tree["decision"]["planner"]) == ("/way_point", "tare")
    file = tmp_path / "robot.toml"
    file.write_text(result.stdout)
    assert run("config", "--config", str(file)).stdout == result.stdout
    assert "safety.speed_limit" in run("config", "--describe").stdout


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["config", "--profile", "husky"], "unknown profile 'husky'"),
        (["config", "--set", "decision.planer=x"], "did you mean 'decision.planner'"),
        (["bridge", "--planner", "nonsense"], "there is no planner 'nonsense'"),
        (["bridge", "--goal", "1,2", "--planner", "greedy"], "does exploration, not navigation"),
        (["bridge", "--planner", "greedy", "--policy", "x.safetensors"], "decision.policy is for hdplanner"),
        (["bridge", "--policy", "/nowhere/x.safetensors"], "cannot read the policy"),
        (["bridge", "--set", "safety.geofence=[[0,0],[2,2],[2,0],[0,2]]"], "sides do not cross"),
        (["bridge", "--set", "decision.live_run=office"], "live_connect"),
        (["command", "goal", "1"], "goal X Y"),
        (["command", "goal", "1", "2m"], "goal X Y"),
        (["command", "go-home"], "reset, goal, explore, stop, release, got 'go-home'"),
        (["command", "checkpoint"], "abort, return-home"),
        (["command", "release"], "command release --who NAME --why REASON"),
        (["command", "release", "--who", "anna"], "requires a name and the reason why it is safe"),
        (["command", "start", "--who", "anna"], "--who and --why are for `release`"),
    ],
)
def test_a_mistake_is_one_line_and_a_non_zero_exit(words, message):
    result = run(*words)
    assert result.exit_code == 1
    assert message in result.stderr
    assert "Traceback" not in result.output


@pytest.mark.parametrize("command", [["bridge"], ["robot"]])
def test_a_taken_port_is_told_before_anything_is_prepared(command, monkeypatch):
    monkeypatch.setitem(sys.modules, f"deploy.{command[0]}.process", None)  # cannot be imported
    with socket.create_server(("127.0.0.1", 0)) as taken:
        result = run(*command, "--listen", f"tcp/127.0.0.1:{taken.getsockname()[1]}")
    assert result.exit_code == 1
    assert "is in use by another process" in result.stderr


def test_a_command_to_nobody_says_where_it_asked():
    result = run("command", "start", "--connect", f"tcp/127.0.0.1:{free_port()}", "--timeout", "0.5")
    assert result.exit_code == 1
    assert "no robot 'robot' answered within 0.5 s" in result.stderr
    assert "asked at tcp/127.0.0.1" in result.stderr


def test_commands_reach_a_bridge_and_topics_shows_it():
    router, config = network(mapping=MAPPING, decision={"task": "navigation", "planner": "astar"})
    endpoint = config.ros.connect[0]
    stop = threading.Event()
    with FakeRobot(DEAD_END, router) as robot, Bridge(config) as bridge:
        thread = threading.Thread(target=bridge.run, args=(stop,))
        thread.start()
        try:
            told = run("command", "goal", "26", "-2.5", "--connect", endpoint)
            assert told.exit_code == 0, told.output
            assert told.stdout.startswith("robot: idle")
            status = json.loads(run("command", "status", "--json", "--connect", endpoint).stdout)
            assert status["target"] == [26.0, -2.5]
            assert "planner" in run("command", "status", "--connect", endpoint).stdout
            refused = run("command", "resume", "--connect", endpoint)
            assert refused.exit_code == 1
            assert "nothing to resume" in refused.stderr
            stopped = run("command", "stop", "--connect", endpoint)
            assert (stopped.exit_code, stopped.stdout[:7]) == (0, "robot: "), stopped.output
            with declare_presence(robot.node.session, "robot", "bridge", "deaf"):
                half = run("command", "stop", "--connect", endpoint, "--timeout", "1")
                assert half.exit_code == 1
                assert half.stdout.startswith("robot: ")
                assert "robot 'robot' did not answer within 1 s (instance deaf): it may still be moving" in half.stderr
                unclear = run("command", "status", "--connect", endpoint)
                assert "2 bridges on this network have the name 'robot'" in unclear.stderr
            # On a loaded machine the nodes may find each other later than the command waits for them.
            for _ in range(10):
                seen = run("topics", "--connect", endpoint)
                assert seen.exit_code == 0, seen.output
                if "/hd_bridge" in seen.stdout:
                    break
            assert "/hd_bridge" in seen.stdout
            assert "/scan" in seen.stdout
            assert "nobody publishes" not in seen.stdout
            lacking = run("topics", "--profile", "cmu", "--connect", endpoint)
            assert "not published, but needed by the bridge: /registered_scan" in lacking.stdout.replace("\n", " ")
            misnamed = run("topics", "--set", "topics.scan=/front/scan", "--connect", endpoint)
            words = " ".join(misnamed.stdout.split())
            assert "sensor_msgs/msg/LaserScan is published on /scan: --set topics.scan=/scan" in words
            for _ in range(10):
                stamped = run("topics", "--set", "driving.message=TwistStamped", "--connect", endpoint)
                words = " ".join(stamped.stdout.split())
                if "/fake_robot speaks" in words:
                    break
            assert "/fake_robot speaks geometry_msgs/msg/Twist on /cmd_vel" in words
            assert "set driving.message=Twist" in words
        finally:
            stop.set()
            thread.join()


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_bridge_process_explores_and_ends_on_sigterm_with_the_robot_stopped(tmp_path):
    router, config = network(mapping=MAPPING, decision={"autostart": True})
    file = tmp_path / "robot.toml"
    file.write_text(to_toml(config))
    with FakeRobot(DEAD_END, router) as robot:
        process = subprocess.Popen(
            [sys.executable, "-m", "deploy", "bridge", "--config", str(file)],
            cwd=ROOT,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            assert eventually(lambda: robot.status.get("state") == "finished", 200)
            assert robot.status["reason"].startswith("complete")
            assert robot.status["distance"] > 15.0
            process.send_signal(signal.SIGTERM)
            assert process.wait(20) == 0
        finally:
            process.kill()
            errors = process.communicate()[1]
    assert "Traceback" not in errors


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_the_robot_stops_when_the_bridge_is_killed(tmp_path):
    router, config = network(mapping=MAPPING, decision={"autostart": True})
    file = tmp_path / "robot.toml"
    file.write_text(to_toml(config))
    with FakeRobot(DEAD_END, router, speed=0.3) as robot:
        process = subprocess.Popen([sys.executable, "-m", "deploy", "bridge", "--config", str(file)], cwd=ROOT)
        try:
            assert eventually(lambda: bool(robot.waypoints) and robot.stops[-1][1] == 0, 120)
        finally:
            process.kill()
        killed = time.monotonic()
        process.wait()
        assert eventually(lambda: robot.stops[-1][1] == 2, 10)
        assert robot.stops[-1][0] - killed < 5.0
        here = robot.pose
        time.sleep(0.5)
        assert robot.pose == here
