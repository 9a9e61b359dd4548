"""The examples run as they stand, each in a folder of its own, and stay short."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "examples"
EXAMPLES = sorted(path.stem for path in FOLDER.glob("*.py"))

pytestmark = pytest.mark.timeout(300)


def run(name, folder):
    """Run an example as its text says, and return what it printed."""
    told = subprocess.run(
        [sys.executable, str(FOLDER / f"{name}.py")], capture_output=True, text=True, cwd=folder, timeout=280
    )
    assert told.returncode == 0, told.stdout + told.stderr
    return told.stdout


def test_there_are_five_and_each_is_short():
    assert EXAMPLES == ["drive_robot", "own_planner", "own_simulator", "plan_on_a_map", "train"]
    for name in EXAMPLES:
        assert len((FOLDER / f"{name}.py").read_text("utf-8").splitlines()) < 60, name


def test_plan_on_a_map_draws_a_picture(tmp_path):
    image = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    assert run("plan_on_a_map", tmp_path).startswith("complete after ")
    with image.open(tmp_path / "plan.png") as picture:
        colours = {colour for _, colour in picture.getcolors()}
    assert {(255, 255, 255), (160, 160, 160), (0, 0, 0), (179, 38, 30)} <= colours


def test_own_planner_explores_and_is_known_to_the_commands(tmp_path):
    lines = run("own_planner", tmp_path).splitlines()
    assert [line.split()[:4] for line in lines] == [[name, "3", "of", "3"] for name in ("curious", "nearest")]
    arguments = ["--planner", "own_planner:CuriousPlanner", "--maps", "generator:rooms?width=320&height=240"]
    # The commands find a module of the folder that they are started in.
    command = [sys.executable, "-P", "-m", "actors.evaluation", "run", *arguments, "--limit", "1", "--jobs", "1"]
    told = subprocess.run([*command, "--out", str(tmp_path)], capture_output=True, text=True, cwd=FOLDER, check=False)
    assert told.returncode == 0, told.stderr
    results = json.loads((tmp_path / "own_planner.CuriousPlanner.json").read_text())
    assert results["episodes"][0]["success"]


def test_own_simulator_is_driven_in(tmp_path):
    dry, rainy = run("own_simulator", tmp_path).splitlines()
    assert dry.startswith("grid")
    assert rainy.startswith("own_simulator:RainySimulator")
    assert dry.split()[1:] != rainy.split()[1:]
    assert float(rainy.split()[3].rstrip("%")) > 99.0


@pytest.mark.slow
def test_train_leaves_a_policy_that_drives(tmp_path):
    assert "example.safetensors: 50 updates" in run("train", tmp_path)
    assert json.loads((tmp_path / "example.json").read_text())["updates"] == 50


@pytest.mark.slow
def test_drive_robot_goes_out_and_comes_home(tmp_path):
    pytest.importorskip("pybullet", reason="PyBullet is not installed")
    lines = run("drive_robot", tmp_path).splitlines()
    states = [line.split()[0] for line in lines]
    assert states[0] in {"running", "holding"}
    assert "returning" in states
    assert states[-1] == "finished"
    assert "back where it began" in lines[-1]
