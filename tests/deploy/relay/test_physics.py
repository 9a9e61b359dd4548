"""A robot that is written with rclpy alone, in physics, driven by the bridge through DDS and the relay."""

import contextlib
import json
import os
import re
import signal
import subprocess
import time

import numpy as np
import psutil
import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed: `make test-ros` runs these")
pytest.importorskip("pybullet", reason="PyBullet is not installed")

from nav_msgs.msg import OccupancyGrid
from std_msgs.msg import String

from actors.tasks.coverage import Coverage
from common.system.runtime import process_environment, python_module
from deploy.profiles import load_deploy_config
from deploy.robot.options import RobotOptions
from deploy.robot.simulation import centred, load_world
from tests.common.bus.processes import ROOT, eventually, free_port
from tests.deploy.relay.dds_robot import TRUTH
from tests.deploy.relay.network import LATCHED, dds_node

SMALL = RobotOptions(map="generator:rooms?width=256&height=256&seed=5", metres_per_pixel=0.09375, range_noise=0.02)
# A fresh install compiles its kernels for some minutes.
START_SECONDS = 500.0


class DdsDeployment:
    """Robot, relay and bridge as processes, watched from DDS."""

    def __init__(self, node, domain, folder, config, common, bridge, options=SMALL):
        self._folder = folder
        self._stack = contextlib.ExitStack()
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        environment = process_environment(threads=1) | {
            "ROS_DOMAIN_ID": str(domain),
            "PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])),
        }
        self.processes = {}
        robot = ["tests.deploy.relay.dds_robot", options.model_dump_json(), config.model_dump_json()]
        for name, command in (
            ("robot", robot),
            ("relay", ["deploy", "relay", *common, "--listen", endpoint]),
            ("bridge", ["deploy", "bridge", *common, *bridge, "--connect", endpoint]),
        ):
            with self._log(name).open("w") as log:
                self.processes[name] = subprocess.Popen(
                    python_module("common.system.tethered", str(os.getpid()), *python_module(*command)),
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    env=environment,
                    cwd=ROOT,
                )
        self.truth, self.status, self.belief = {}, {}, None
        within = config.ros.namespace and f"/{config.ros.namespace}"
        node.create_subscription(String, f"{within}/{TRUTH}", self._hear_truth, 10)
        node.create_subscription(String, f"{within}/status", self._hear_status, 10)
        node.create_subscription(OccupancyGrid, f"{within}/belief", self._hear_belief, LATCHED)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for name in ("bridge", "relay", "robot"):
            process = self.processes[name]
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(10)
            process.kill()
            process.wait()

    def until(self, condition, seconds, what):
        end = time.monotonic() + seconds
        while not condition():
            dead = [name for name, process in self.processes.items() if process.poll() is not None]
            logs = {name: self._log(name).read_text()[-1500:] for name in self.processes}
            assert not dead, (dead, logs)
            assert time.monotonic() < end, (what, self.status, logs)
            time.sleep(0.05)

    def log(self, name):
        return self._log(name).read_text("utf-8")

    def _log(self, name):
        return self._folder / f"{name}.log"

    def _hear_truth(self, text):
        self.truth = json.loads(text.data)

    def _hear_status(self, text):
        self.status = json.loads(text.data)

    def _hear_belief(self, grid):
        self.belief = grid


def settings(domain, namespace=""):
    """Parameters of a robot with relative names."""
    names = {"odometry": "odom", "scan": "scan", "velocity": "cmd_vel", "status": "status", "belief": "belief"}
    every = [f"ros.domain={domain}", *(f"topics.{field}={name}" for field, name in names.items())]
    if namespace:
        every.append(f"ros.namespace={namespace}")
    return load_deploy_config(overrides=every), [part for each in every for part in ("--set", each)]


def explored(belief, world, config):
    coverage = Coverage(world, config.mapping.robot_radius)
    cells = np.array(belief.data, np.int8).reshape(belief.info.height, belief.info.width)
    corner = belief.info.origin.position
    coverage.update(cells, belief.info.resolution, (corner.x, corner.y))
    return coverage.explored


@pytest.mark.timeout(900)
def test_it_explores_goes_to_a_target_and_stops_when_the_relay_dies(domain, tmp_path):
    config, common = settings(domain)
    world = centred(load_world(SMALL))
    with (
        dds_node("judge", domain) as node,
        DdsDeployment(node, domain, tmp_path, config, common, ["--planner", "tour", "--autostart"]) as robot,
    ):
        robot.until(lambda: robot.status.get("state") == "running", START_SECONDS, "it does not start")
        relay = psutil.Process(robot.processes["relay"].pid)
        began, busy = time.monotonic(), sum(relay.cpu_times()[:2])
        robot.until(lambda: robot.status["state"] in {"finished", "failed"}, 150.0, "it does not end")
        share = (sum(relay.cpu_times()[:2]) - busy) / (time.monotonic() - began)
        seen = explored(robot.belief, world, config)
        print(robot.truth, f"{seen:.4f} explored, relay {share:.1%} of a core, {relay.memory_info().rss >> 20} MB")
        assert robot.status["state"] == "finished", robot.status
        assert seen >= 0.98
        assert robot.truth["distance"] > 1.0
        # Then it goes to a target by a command in DDS: back to where it began.
        commands = node.create_publisher(String, "/hd/command", 10)
        assert eventually(lambda: commands.get_subscription_count() > 0)
        home = [0.0, 0.0]
        commands.publish(String(data=f"goal {home[0]} {home[1]}"))
        robot.until(lambda: robot.status["task"] == "navigation", 10.0, "it hears no target")
        robot.until(lambda: robot.truth["speed"] > 0.3 or robot.status["state"] == "finished", 20.0, "it stands")
        robot.until(lambda: robot.status["state"] == "finished", 60.0, "it does not arrive")
        assert np.hypot(robot.truth["x"] - home[0], robot.truth["y"] - home[1]) <= 1.0
        assert robot.truth["collisions"] == 0
        lost = re.findall(r"lost (\d+)", robot.log("relay"))
        assert not lost or lost[-1] == "0"
        # And again into the unknown, in the midst of which the relay is killed: it stands.
        x, y = world.target or (3.0, 0.0)
        commands.publish(String(data=f"goal {x} {y}"))
        robot.until(lambda: abs(robot.truth["speed"]) > 0.2, 30.0, "it does not drive")
        relay.kill()
        killed = last_moved = robot.truth["time"]
        while robot.truth["time"] < killed + 3.0:
            if max(abs(robot.truth["speed"]), abs(robot.truth["turn_rate"])) > 0.02:
                last_moved = robot.truth["time"]
            time.sleep(0.01)
        print(f"standing {last_moved - killed:.2f} s after the relay was killed")
        assert last_moved - killed <= SMALL.command_timeout + 0.5 + 0.2
        assert robot.truth["collisions"] == 0


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_two_robots_in_one_domain_explore_each_for_itself(domain, tmp_path):
    """Both live in worlds of their own; names, commands and stops must not mix."""
    with contextlib.ExitStack() as stack:
        node = stack.enter_context(dds_node("judge", domain))
        robots = []
        for number in (1, 2):
            folder = tmp_path / str(number)
            folder.mkdir()
            config, common = settings(domain, f"robot{number}")
            options = SMALL.model_copy(update={"seed": number})
            bridge = ["--planner", "nearest", "--autostart"]
            robots.append(stack.enter_context(DdsDeployment(node, domain, folder, config, common, bridge, options)))
        for robot in robots:
            robot.until(lambda robot=robot: robot.status.get("state") == "finished", 500.0, "it does not end")
            assert robot.truth["collisions"] == 0
        assert [robot.status["name"] for robot in robots] == ["robot1", "robot2"]
