"""The built wheel, installed in an environment of its own and used from a folder that holds packages of our names.

An editable installation hides which files the wheel lacks, and which modules a process takes from the current folder.
"""

import json
import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest

from deploy.robot.deployment import free_endpoint

ROOT = Path(__file__).parents[2]
OURS = ("common", "actors", "deploy", "learner", "hdplanner")
SMALL = "generator:rooms?width=256&height=192"
FOREIGN = """
from pathlib import Path
Path(__file__).with_name("imported").touch()
raise SystemExit("foreign code was imported")
"""

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Build the wheel, install it, and return the folder of its commands."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    # Building writes beside the sources, so it gets a copy of what a wheel can come from.
    for name in (*OURS, "docs"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__", "pictures"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    pip = ["-m", "pip", "--disable-pip-version-check", "--quiet"]
    build = [sys.executable, *pip, "wheel", "--no-deps", "--no-build-isolation", "-w", str(folder), str(source)]
    subprocess.run(build, check=True, env=_environment())
    (wheel,) = folder.glob("hdplanner-*.whl")
    shutil.rmtree(source)
    home = folder / "venv"
    venv.create(home, with_pip=True)
    python = home / "bin" / "python"
    subprocess.run([python, *pip, "install", "--no-deps", str(wheel)], check=True, env=_environment())
    # What it depends on is that of this environment: a file here is not read for further ones, so that an editable
    # installation there stays out.
    (packages,) = home.glob("lib/python*/site-packages")
    borrowed = [path for path in sys.path if path.endswith("site-packages")]
    (packages / "borrowed.pth").write_text("\n".join(borrowed), "utf-8")
    where = subprocess.run(
        [python, "-P", "-c", "import common, hdplanner; print(common.__file__, hdplanner.__file__)"],
        capture_output=True,
        text=True,
        check=True,
        env=_environment(),
    )
    assert where.stdout.count(str(home)) == 2, where.stdout
    return home / "bin"


@pytest.fixture
def foreign(tmp_path):
    """A user's folder with packages of our names; importing any of them leaves a mark, and ends the process."""
    for name in OURS:
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(FOREIGN, "utf-8")
    yield tmp_path
    assert [path.parent.name for path in tmp_path.glob("*/imported")] == []


def _environment():
    return {key: value for key, value in os.environ.items() if key != "PYTHONPATH" and not key.startswith("HD")}


def use(installed, folder, command, *arguments):
    """Run an installed command in a folder to its end, and return what it told."""
    told = subprocess.run(
        [installed / command, *arguments], cwd=folder, env=_environment(), capture_output=True, text=True, timeout=1000
    )
    assert told.returncode == 0, told.stdout + told.stderr
    return told.stdout


def test_it_trains_with_actors_and_evaluators(installed, foreign):
    settings = [
        f"maps.train={SMALL}",
        f"maps.validation={SMALL}",
        "maps.validation_count=1",
        "network.width=16",
        "network.heads=2",
        "network.layers=1",
        "task.max_steps=8",
        "replay.min_steps=40",
        "learner.batch_size=8",
        "learner.publish_every=2",
        "learner.total_updates=20",
        "learner.threads=1",
    ]
    words = [word for setting in settings for word in ("--set", setting)]
    helpers = ["--actors", "1", "--evaluators", "1", "--sim", "grid", "--listen", free_endpoint()]
    use(installed, foreign, "hd-learner", "start", "--run", "wheel", *helpers, *words)
    episodes = [json.loads(line) for line in (foreign / "runs" / "wheel" / "episodes.jsonl").read_text().splitlines()]
    assert {episode["role"] for episode in episodes} >= {"train"}
    use(installed, foreign, "hd-learner", "export", "--run", "wheel", "--which", "last")
    assert json.loads((foreign / "wheel.json").read_text())["updates"] == 20


def test_it_evaluates(installed, foreign):
    arguments = ["--planner", "hdplanner,nearest", "--maps", SMALL, "--limit", "1", "--jobs", "2", "--out", "results"]
    use(installed, foreign, "hd-eval", "run", *arguments)
    for planner in ("hdplanner", "nearest"):
        results = json.loads((foreign / "results" / f"{planner}.json").read_text())
        assert results["episodes"][0]["success"]
    assert "nearest" in use(installed, foreign, "hd-eval", "table", "results")


def test_it_bridges_a_robot_behind_a_watchdog(installed, foreign):
    pytest.importorskip("pybullet", reason="PyBullet is not installed")
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    arguments = ["--planner", "nearest", "--map", SMALL, "--speed-factor", "4", "--video", ""]
    told = use(installed, foreign, "hd-deploy", "demo", *arguments)
    verdict = json.loads(told)
    assert verdict["state"] == "finished"
    assert verdict["collisions"] == 0


def test_it_finds_a_planner_of_the_users_folder(installed, foreign):
    (foreign / "my_planner.py").write_text(
        "from hdplanner import ViewpointPlanner\n"
        "class First(ViewpointPlanner):\n"
        "    name = 'first'\n"
        "    def choose(self, mapper, pose, candidates, positions):\n"
        "        return [int(candidates[0])]\n",
        "utf-8",
    )
    arguments = ["--planner", "my_planner:First", "--maps", SMALL, "--limit", "1", "--jobs", "1", "--out", "results"]
    use(installed, foreign, "hd-eval", "run", *arguments)
    results = json.loads((foreign / "results" / "my_planner.First.json").read_text())
    assert results["episodes"][0]["steps"] > 0


def test_every_command_tells_the_version(installed, foreign):
    for command in ("hdplanner", "hd-learner", "hd-actor", "hd-eval", "hd-deploy"):
        assert use(installed, foreign, command, "--version").startswith("hdplanner 0.")
