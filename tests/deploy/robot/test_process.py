"""`hd-deploy robot` as a process: it ends when told to, in good order, and with whoever started it."""

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest
import typer

pytest.importorskip("pybullet", reason="PyBullet is not installed")

from deploy.cli import app
from deploy.robot.deployment import free_endpoint
from deploy.robot.options import RobotOptions
from deploy.robot.trial import robot_arguments

COMMAND = ["deploy", "robot", "--map", "generator:rooms?width=192&height=192", "--rays", "90"]

pytestmark = pytest.mark.timeout(300)


@pytest.fixture
def start(tmp_path):
    started = []

    def run(*prefix):
        with (tmp_path / "log").open("w") as log:
            command = [sys.executable, "-m", *prefix, *COMMAND, "--listen", free_endpoint()]
            started.append(subprocess.Popen(command, stdout=log, stderr=log))
        lives(tmp_path / "log", started[-1])
        return started[-1], tmp_path / "log"

    yield run
    for process in started:
        if process.poll() is None:
            process.kill()
            process.wait()


def lives(log, process):
    end = time.monotonic() + 200.0
    while "lives in" not in log.read_text():
        assert process.poll() is None, log.read_text()
        assert time.monotonic() < end, log.read_text()
        time.sleep(0.05)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_in_good_order(start, number):
    process, log = start()
    process.send_signal(number)
    assert process.wait(60) == 0
    text = log.read_text()
    assert "collisions" in text
    assert "Traceback" not in text


def test_it_ends_with_a_killed_parent(tmp_path):
    endpoint, log = free_endpoint(), tmp_path / "log"
    parent = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "import os, subprocess, sys, time\n"
            "python = [sys.executable, '-m']\n"
            "command = [*python, 'common.system.tethered', str(os.getpid()), *python, *sys.argv[1:]]\n"
            "with open(os.environ['LOG'], 'w') as log:\n"
            "    print(subprocess.Popen(command, stdout=log, stderr=log).pid, flush=True)\n"
            "time.sleep(600)",
            *COMMAND,
            "--listen",
            endpoint,
        ],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "LOG": str(log)},
    )
    robot = psutil.Process(int(parent.stdout.readline()))
    parent.stdout.close()
    lives(log, parent)
    parent.kill()
    parent.wait()
    _, alive = psutil.wait_procs([robot], timeout=60)
    for process in alive:
        process.kill()
    assert not alive


def test_the_command_line_takes_every_option_of_the_robot():
    command = typer.main.get_command(app).get_command(None, "robot")
    known = {name for parameter in command.params for name in parameter.opts}
    assert {"--" + name.replace("_", "-") for name in RobotOptions.model_fields} <= known


def test_options_become_arguments_of_the_command():
    assert robot_arguments(RobotOptions()) == []
    options = RobotOptions(map="hall.png", speed_factor=2.0, follow=False, layers=16)
    assert robot_arguments(options) == [
        "--map",
        "hall.png",
        "--speed-factor",
        "2.0",
        "--layers",
        "16",
        "--no-follow",
    ]
