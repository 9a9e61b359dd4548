"""docs/extending.md does what it says: its code blocks are what a stranger copies."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from hdplanner import evaluate, open_sources
from tests.plugins import install

PAGE = (Path(__file__).parents[2] / "docs" / "extending.md").read_text("utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
SMALL = "generator:rooms?width=320&height=240"


def block(word: str) -> str:
    """Return the only code block that holds a word."""
    (found,) = [text for text in BLOCKS if word in text]
    return found


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The folder of somebody who copied the blocks, and works there."""
    (tmp_path / "my_planner.py").write_text(block("class NearestViewpoint"))
    (tmp_path / "my_tasks.py").write_text(block("class HalfGoal"))
    (tmp_path / "my_maps.py").write_text(block("class Arena"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr("common.tasks._loaded", {})
    yield tmp_path
    for name in ("my_planner", "my_tasks", "my_maps"):
        sys.modules.pop(name, None)


def test_a_planner(folder):
    results = evaluate("my_planner:NearestViewpoint", [SMALL], count=2)
    assert [result.success for result in results] == [True, True]


@pytest.mark.parametrize(
    "world",
    [
        "rooms?width=240&height=192&start_offset=7&seed=3",
        "office?width=240&height=192&seed=4",
    ],
)
def test_a_planner_of_a_robot_that_stands_beside_its_viewpoint(folder, world):
    (result,) = evaluate("my_planner:NearestViewpoint", [f"generator:{world}"], count=1)
    assert result.success


def test_a_task(folder):
    (half,) = evaluate("tour", [SMALL], count=1, task="my_tasks:HALF")
    (whole,) = evaluate("tour", [SMALL], count=1)
    assert half.success
    assert 0.5 <= half.explored_rate < whole.explored_rate
    assert half.steps < whole.steps


def test_worlds(folder):
    source = open_sources(["generator:my_maps:Arena?width=320&height=256"], None, "navigation")
    world = source.world(3)
    assert world.free.shape == (256, 320)
    assert world.target is not None
    assert evaluate("nearest", ["generator:my_maps:Arena?width=320&height=256"], count=1)[0].success


def test_everything_at_once_by_the_command_in_processes_of_its_own(folder):
    """Names of a package, in a command and its workers: nothing of this repository was edited for any of them."""
    (section,) = [text for text in re.findall(r"```toml\n(.*?)```", PAGE, flags=re.DOTALL) if "entry-points" in text]
    points = re.sub(r'\[project\.entry-points\."([\w.]+)"\]', r"[\1]", section).replace('"', "")
    site = folder / "site"
    (site / "my_package").mkdir(parents=True)
    (site / "my_package" / "__init__.py").touch()
    examples = Path(__file__).parents[2] / "examples"
    for name, text in {
        "planner": (examples / "own_planner.py").read_text("utf-8"),
        "simulator": (examples / "own_simulator.py").read_text("utf-8"),
        "tasks": block("class HalfGoal"),
        "maps": block("class Arena"),
    }.items():
        (site / "my_package" / f"{name}.py").write_text(text)
    install(site, "my-package", points)
    command = [sys.executable, "-m", "actors.evaluation", "run", "--planner", "curious,tour", "--task", "half"]
    command += ["--sim", "rainy", "--maps", "generator:arena?width=320&height=256", "--limit", "1", "--jobs", "1"]
    environment = {**os.environ, "PYTHONPATH": f"{Path(__file__).parents[2]}{os.pathsep}{site}"}
    told = subprocess.run(
        [*command, "--out", "results"], capture_output=True, text=True, cwd=folder, env=environment, check=False
    )
    assert told.returncode == 0, told.stderr
    for planner in ("curious", "tour"):
        text = (folder / "results" / f"{planner}.json").read_text()
        assert '"task":"half"' in text
        assert '"success":true' in text
    parts = subprocess.run(
        [sys.executable, "-m", "hdplanner", "parts"], capture_output=True, text=True, env=environment, check=True
    )
    for line in ("curious", "rainy", "half", "arena"):
        assert re.search(rf"^  {line} ", parts.stdout, flags=re.MULTILINE)


def test_reinforcement_learning(folder, capsys):
    pytest.importorskip("gymnasium", reason="Gymnasium is not installed")
    exec(compile(block("import gymnasium"), "extending.md", "exec"), {})
    assert "complete" in capsys.readouterr().out
