"""Learned baselines from their presets to rows of a table, by the commands that a user gives, with real processes."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from actors.evaluation.cli import app as eval_app
from actors.evaluation.settings import EvaluationSettings
from actors.evaluation.worker import Worker
from common.config import TaskConfig
from common.policies.policy_file import read_card
from learner.cli import app as learner_app

WORLDS = "generator:rooms?width=256&height=192&seed=9"
SETTINGS = [
    "maps.train=generator:rooms?width=256&height=192",
    "network.width=16",
    "network.heads=2",
    "network.layers=1",
    "task.max_steps=12",
    "replay.min_steps=20",
    "learner.batch_size=8",
    "learner.updates_per_step=0.2",
    "learner.total_updates=6",
    "learner.publish_every=2",
    "learner.threads=1",
]


class Training:
    """A run of a preset, whose learner starts one actor process."""

    def __init__(self, folder: Path, preset: str) -> None:
        self.folder = folder
        self.preset = preset
        with socket.socket() as found:
            found.bind(("127.0.0.1", 0))
            self.endpoint = f"tcp/127.0.0.1:{found.getsockname()[1]}"

    def start(self) -> None:
        settings = [part for setting in SETTINGS for part in ("--set", setting)]
        self._run("start", "--preset", self.preset, *settings)

    def resume(self, updates: int) -> None:
        self._run("resume", "--set", f"learner.total_updates={updates}")

    def export(self, name: str) -> Path:
        """Write the last policy; it is called by the name of its file."""
        file = self.folder / name
        runs = ["--run", "base", "--runs", str(self.folder / "runs")]
        call(learner_app, "export", *runs, "--which", "last", "--out", str(file))
        return file

    def _run(self, verb: str, *arguments: str) -> None:
        command = [sys.executable, "-m", "learner", verb, "--run", "base", "--listen", self.endpoint, "--actors", "1"]
        done = subprocess.run(
            [*command, *arguments],
            cwd=self.folder,
            env={key: value for key, value in os.environ.items() if not key.startswith("HD_")},
            capture_output=True,
            text=True,
            timeout=500,
        )
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
        episodes = (self.folder / "runs" / "base" / "episodes.jsonl").read_text().splitlines()
        assert {json.loads(line)["driver"] for line in episodes} == {"policy"}


def call(app: object, *arguments: str) -> str:
    """Give a command in this process and return what it says."""
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    return done.output


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_images_come_from_a_real_actor_to_a_real_learner(tmp_path: Path) -> None:
    training = Training(tmp_path, "cnn")
    training.start()
    file = training.export("cnn.safetensors")
    card = read_card(file)
    assert (card.network.variant, card.task, card.updates) == ("cnn", "exploration", 6)
    settings = EvaluationSettings(
        maps=(WORLDS,), limit=1, task=TaskConfig(max_steps=6), policy=str(file), time_limit=600.0
    )
    worker = Worker(settings, lambda *_: None)
    outcome = worker.run("hdplanner", worker.worlds.numbers[0])
    worker.close()
    assert not outcome.crashed and outcome.steps > 0, outcome.reason


@pytest.mark.slow
@pytest.mark.timeout(1500)
@pytest.mark.parametrize("preset", ["cnn", "ariadne", "ca"])
def test_a_baseline_from_its_preset_to_a_table(preset: str, tmp_path: Path) -> None:
    training = Training(tmp_path, preset)
    training.start()
    training.resume(9)
    files = [training.export(f"{preset}-1.safetensors")]
    assert read_card(files[0]).updates == 9
    pytest.importorskip("onnxruntime")
    files.append(training.export(f"{preset}-2.onnx"))
    results = tmp_path / "results"
    task = next(iter(read_card(files[0]).tasks))
    options = ["--task", task, "--maps", WORLDS, "--limit", "1", "--jobs", "1", "--set", "task.max_steps=6"]
    for file in files:
        named = ["--planner", "hdplanner", "--policy", str(file), "--label", file.stem]
        call(eval_app, "run", *named, *options, "--time-limit", "600", "--out", str(results))
    one, other = (json.loads((results / f"{file.stem}.json").read_text())["episodes"][0] for file in files)
    assert one["steps"] > 0
    assert one["waypoints"] == other["waypoints"]
    table = call(eval_app, "table", str(results))
    assert all(file.stem in table for file in files)
