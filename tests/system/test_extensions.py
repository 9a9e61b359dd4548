"""A simulator, a task and a generator of one's own in a run of several processes: learner, actor and evaluator."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from deploy.robot.deployment import free_endpoint

ROOT = Path(__file__).parents[2]

MINE = """
from dataclasses import replace
from actors.maps.generators.rooms import Rooms
from actors.simulators.grid import GridSimulator
from actors.tasks import ExplorationGoal
from common.tasks import EXPLORATION

class Simulator(GridSimulator): ...

class Generator(Rooms):
    kind = "mine"

class HalfGoal(ExplorationGoal):
    def complete(self, coverage, pose):
        return coverage.explored >= 0.5

HALF = replace(EXPLORATION, name="half", goal=HalfGoal, expert=None)
"""

SETTINGS = [
    "simulator.name=mine:Simulator",
    "task.name=mine:HALF",
    "maps.train=generator:mine:Generator?width=256&height=192",
    "maps.validation=generator:mine:Generator?width=256&height=192&seed=9",
    "maps.validation_count=1",
    "network.width=16",
    "network.heads=2",
    "network.layers=1",
    "replay.min_steps=40",
    "learner.batch_size=8",
    "learner.publish_every=2",
    "learner.total_updates=30",
    "learner.threads=1",
]


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_local_actors_may_load_what_their_learners_user_named(tmp_path):
    (tmp_path / "mine.py").write_text(MINE)
    command = [
        sys.executable,
        "-P",
        "-m",
        "learner",
        "start",
        "--run",
        "mine",
        "--actors",
        "1",
        "--evaluators",
        "1",
    ]
    command += ["--listen", free_endpoint(), *(word for setting in SETTINGS for word in ("--set", setting))]
    environment = {key: value for key, value in os.environ.items() if not key.startswith("HD_")}
    environment["PYTHONPATH"] = str(ROOT)
    told = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=380, check=False
    )
    assert told.returncode == 0, told.stdout + told.stderr
    lines = (tmp_path / "runs" / "mine" / "episodes.jsonl").read_text().splitlines()
    episodes = [json.loads(line) for line in lines]
    assert {episode["task"] for episode in episodes} == {"half"}
    assert {episode["simulator"] for episode in episodes} == {"mine:Simulator"}
    assert all(episode["map_name"].startswith("mine") for episode in episodes)
    assert all(episode["explored"] >= 0.5 for episode in episodes if episode["success"])
