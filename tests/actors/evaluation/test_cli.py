import signal
import subprocess
import sys
import time

import numpy as np
import psutil
import pytest
from PIL import Image
from typer.testing import CliRunner

from actors.evaluation.cli import app
from actors.evaluation.results import read_results
from tests.actors.evaluation.small import MAPS
from tests.actors.maps.ros_files import room, write_ros

WHERE = ["--maps", MAPS, "--limit", "2"]


def call(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Results of two planners on two small worlds, made by the command itself."""
    out = tmp_path_factory.mktemp("results")
    result = call(
        "run", "--planner", "greedy,nearest", *WHERE, "--jobs", "1", "--out", out, "--copy-to", f"file://{out}/copies"
    )
    assert result.exit_code == 0, result.output
    assert "greedy.json: 2 episodes" in result.output.replace("\n", "")
    return out


def test_the_table_compares(folder):
    result = call("table", folder, "--baseline", "nearest", "--format", "markdown")
    assert result.exit_code == 0
    lines = result.output.splitlines()
    assert lines[0].startswith("| planner | maps | mean [m]")
    assert lines[2].startswith("| greedy | 2 |")
    assert "paired by map with nearest" in result.output


def test_results_at_a_url_are_read_like_those_of_this_machine(folder, tmp_path):
    here = call("table", folder).output
    assert call("table", f"file://{folder}/copies").output == here
    assert call("table", f"file://{folder}/copies/greedy.json", folder / "nearest.json").output == here
    for place, word in ((f"file://{tmp_path}", "there are no results files"), ("nowhere://x", "fsspec knows")):
        result = call("table", place)
        assert result.exit_code == 1
        assert word in " ".join(result.output.split())
    result = call("table", f"file://{tmp_path}/gone.json")
    assert result.exit_code == 1
    assert "make one with 'hd-eval run'" in " ".join(result.output.split())


def test_a_replay_agrees_and_finds_a_changed_figure(folder, tmp_path):
    result = call("replay", folder, *WHERE)
    assert result.exit_code == 0, result.output
    assert "greedy: 2 of 2 episodes agree" in result.output
    text = (folder / "greedy.json").read_text().replace('"success":true', '"success":false', 1)
    (tmp_path / "greedy.json").write_text(text)
    result = call("replay", tmp_path, *WHERE)
    assert result.exit_code == 1
    assert "1 of 2 episodes agree" in result.output
    assert "success says false" in result.output


def test_all_plots_are_drawn(folder, tmp_path):
    result = call("plot", folder, *WHERE, "--out", tmp_path / "pictures")
    assert result.exit_code == 0, result.output
    names = sorted(path.name.split("-")[0].removesuffix(".png") for path in (tmp_path / "pictures").iterdir())
    assert names == ["boxes", "coverage", "scatter", "trajectories"]
    for path in (tmp_path / "pictures").iterdir():
        with Image.open(path) as picture:
            assert np.asarray(picture.convert("L")).std() > 5


def test_a_gif_shows_the_episode(folder, tmp_path):
    result = call("video", folder / "greedy.json", *WHERE, "--out", tmp_path / "a.gif", "--width", "160")
    assert result.exit_code == 0, result.output
    with Image.open(tmp_path / "a.gif") as video:
        assert video.size == (160, 142)
        assert video.n_frames > 4
        first = np.asarray(video.convert("RGB"), dtype=int)
        video.seek(video.n_frames - 1)
        last = np.asarray(video.convert("RGB"), dtype=int)
    assert np.mean(np.abs(first - last).sum(axis=2) > 30) > 0.05


def test_an_mp4_is_written(folder, tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    result = call("video", folder / "greedy.json", *WHERE, "--out", tmp_path / "a.mp4", "--width", "160")
    assert result.exit_code == 0, result.output
    assert b"ftyp" in (tmp_path / "a.mp4").read_bytes()[:16]


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["run", "--planner", "gredy", *WHERE, "--out", "x"], "did you mean 'greedy'"),
        (
            ["run", "--planner", "hdplanner", "--policy", "no.safetensors", *WHERE, "--out", "x"],
            "cannot read the policy",
        ),
        (["run", "--planner", "greedy", "--maps", "nowhere/", "--out", "x"], "no such folder"),
        (["run", "--planner", "greedy", *WHERE, "--set", "task.max_step=3", "--out", "x"], "max_step"),
        (["run", "--planner", "os:getcwd", *WHERE, "--out", "x"], "called with a MappingConfig"),
        (["run", "--planner", "builtins:repr", *WHERE, "--out", "x"], "'builtins:repr' is no planner"),
        (["table", "nowhere"], "hd-eval run"),
        (["video", "nowhere.json", *WHERE, "--out", "a.gif"], "cannot read"),
    ],
)
def test_mistakes_are_one_clear_line(arguments, word, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = call(*arguments)
    assert result.exit_code == 1
    assert word in result.output.replace("\n", " ")
    assert "Traceback" not in result.output


def test_plots_of_routes_need_maps_and_videos_a_suffix(folder, tmp_path):
    assert "--maps" in call("plot", folder, "--out", tmp_path).output
    result = call("video", folder / "greedy.json", *WHERE, "--out", tmp_path / "a.avi")
    assert result.exit_code == 1
    assert ".gif or .mp4" in result.output


@pytest.mark.parametrize("command", ["run", "table", "plot", "video", "replay"])
def test_help_shows_examples(command):
    result = call(command, "--help")
    assert result.exit_code == 0
    assert f"hd-eval {command}" in result.output


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_leaves_whole_results_and_no_process(tmp_path, number):
    command = [sys.executable, "-m", "actors.evaluation", "run", "--planner", "greedy", "--maps", MAPS]
    command += ["--limit", "1000", "--jobs", "1", "--out", str(tmp_path)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    journal = tmp_path / "greedy.jsonl"
    while not journal.exists() or journal.read_text().count("\n") < 3:
        assert process.poll() is None
        time.sleep(0.2)
    children = psutil.Process(process.pid).children()
    assert any("actors.evaluation.worker" in child.cmdline() for child in children)
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in errors
    assert "the same command continues" in errors
    _, left = psutil.wait_procs(children, timeout=10)
    assert not left
    done = read_results(tmp_path / "greedy.json").episodes
    assert len(done) == journal.read_text().count("\n") - 1
    # The same command continues where it was.
    assert call("run", "--planner", "greedy", "--maps", MAPS, "--limit", "2", "--out", tmp_path).exit_code == 0
    assert len(read_results(tmp_path / "greedy.json").episodes) == 2


def test_a_map_of_ones_own_is_explored_from_a_start_in_metres(tmp_path):
    path = write_ros(tmp_path / "plan.yaml", room(240, 160), resolution=0.1, origin=[-5.0, -4.0, 0.0])
    where = ["--maps", path, "--start", "-2.5", "3.0"]
    out = tmp_path / "results"
    result = call("run", "--planner", "nearest", *where, "--jobs", "1", "--out", out)
    assert result.exit_code == 0, result.output
    assert "settings of floorplans: mapping.resolution=0.1" in result.output and "warning" not in result.output
    (episode,) = read_results(out / "nearest.json").episodes
    assert episode.map == "plan.yaml?start=-2.5,3.0" and episode.success
    # Pixels of the image: x right, y down, (0, 0) the centre of the top left one.
    assert episode.waypoints[0] == pytest.approx((24.5, 89.5))
    assert read_results(out / "nearest.json").metres_per_pixel == 0.1
    result = call("replay", out, *where)
    assert result.exit_code == 0 and "1 of 1 episodes agree" in result.output


def test_a_limit_that_is_too_small_is_warned_of(tmp_path):
    where = ["--maps", "generator:office", "--limit", "1", "--set", "task.max_steps=3"]
    result = call("run", "--planner", "nearest", *where, "--jobs", "1", "--out", tmp_path)
    assert result.exit_code == 0, result.output
    assert "warning: 3 decisions are likely to be too few for 1 of 1 worlds looked at: office-0, " in result.output
    assert "settings of" not in result.output
