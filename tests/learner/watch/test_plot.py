"""The learning curve as a picture."""

import json
import re

import pytest
from typer.testing import CliRunner

from learner.cli import app
from learner.watch.plot import read_curves, read_family_curves


def row(time, role="train", version=1, distance=100.0, success=True, driver="policy"):
    return {
        "time": time, "actor": "desk-0", "updates": 10 * version, "role": role, "driver": driver, "version": version,
        "distance": distance, "success": success, "task": "exploration", "map_name": "a", "simulator": "grid",
        "steps": 9, "explored": 1.0, "reward": 1.0, "collisions": 0, "duration": 1.0,
    }  # fmt: skip


@pytest.fixture
def runs(tmp_path):
    rows = [row(60.0 * i, distance=200.0 - i) for i in range(60)]
    rows += [row(3600.0 + i, driver="expert", distance=1.0) for i in range(5)]
    rows += [row(4000.0, "evaluate", 1, 90.0, False), row(4001.0, "evaluate", 1, 70.0)]
    rows += [row(4060.0, "evaluate", 2, 50.0)]  # a round that is not complete
    (tmp_path / "office").mkdir()
    (tmp_path / "office" / "episodes.jsonl").write_text("".join(json.dumps(each) + "\n" for each in rows))
    return tmp_path


def test_points_are_means_of_what_they_say(runs):
    training, evaluation = read_curves(runs / "office" / "episodes.jsonl")
    assert training.distance[-1] == pytest.approx(sum(200.0 - i for i in range(10, 60)) / 50)
    assert training.minutes[-1] == pytest.approx(59.0)
    assert evaluation.distance.tolist() == [80.0]
    assert evaluation.success.tolist() == [0.5]
    assert evaluation.updates.tolist() == [10.0]


def test_the_command_writes_a_picture(runs, tmp_path):
    out = tmp_path / "pictures" / "curve.png"
    words = ["plot", "--runs", str(runs), "--run", "office", "--out", str(out), "--line", "greedy=261"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    assert out.read_bytes().startswith(b"\x89PNG")
    assert "1 evaluations, newest 80.0 m, 50% complete" in result.stdout


def test_a_yardstick_above_the_curves_is_inside_the_picture(runs, tmp_path):
    out = tmp_path / "curve.svg"
    words = ["plot", "--runs", str(runs), "--run", "office", "--out", str(out), "--line", "random=900"]
    assert CliRunner().invoke(app, words).exit_code == 0
    drawn = out.read_text()
    place = re.search(r"<!-- random 900 m -->\s*<g[^>]* transform=\"translate\([\d.]+ ([-\d.]+)\)", drawn)
    height = re.search(r"height=\"([\d.]+)pt\"", drawn)
    assert 0.0 < float(place[1]) < float(height[1])


def test_a_family_without_a_curve_yet_leaves_its_picture_empty(runs, tmp_path):
    episodes = runs / "office" / "episodes.jsonl"
    lines = [json.dumps(json.loads(line) | {"family": "tunnel"}) for line in episodes.read_text().splitlines()]
    episodes.write_text("\n".join([json.dumps(row(0.0) | {"family": "office"}), *lines, ""]))
    words = ["plot", "--runs", str(runs), "--run", "office", "--out", str(tmp_path / "curve.png"), "--by-family"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.exception


def test_too_few_episodes_for_a_curve_are_an_error_in_one_line(runs):
    (runs / "office" / "episodes.jsonl").write_text("".join(json.dumps(row(60.0 * i)) + "\n" for i in range(9)))
    result = CliRunner().invoke(app, ["plot", "--runs", str(runs), "--run", "office"])
    assert result.exit_code == 1
    assert "expected 10 training episodes" in result.stderr


def test_a_window_and_updates_can_be_chosen(runs, tmp_path):
    training, _ = read_curves(runs / "office" / "episodes.jsonl", window=1)
    assert training.distance[-1] == pytest.approx(141.0)
    out = tmp_path / "curve.png"
    words = ["plot", "--runs", str(runs), "--run", "office", "--out", str(out), "--over", "updates", "--window", "5"]
    assert CliRunner().invoke(app, words).exit_code == 0
    assert out.is_file()


def test_each_family_of_worlds_has_curves_of_its_own(runs, tmp_path):
    episodes = runs / "office" / "episodes.jsonl"
    lines = episodes.read_text().splitlines()
    families = ["office", "tunnel"] * len(lines)
    mixed = [json.loads(line) | {"family": family} for line, family in zip(lines, families, strict=False)]
    episodes.write_text("".join(json.dumps(each) + "\n" for each in mixed))
    curves = read_family_curves(episodes)
    assert list(curves) == ["office", "tunnel"]
    assert curves["office"][0].distance[-1] == pytest.approx(sum(200.0 - i for i in range(0, 60, 2)) / 30)
    assert curves["tunnel"][0].distance[-1] == pytest.approx(sum(200.0 - i for i in range(1, 60, 2)) / 30)
    # Both begin when the run did.
    assert curves["tunnel"][0].minutes[-1] == pytest.approx(59.0)
    out, other = tmp_path / "families.png", tmp_path / "run.png"
    words = ["plot", "--runs", str(runs), "--run", "office", "--out"]
    assert CliRunner().invoke(app, [*words, str(out), "--by-family"]).exit_code == 0
    assert CliRunner().invoke(app, [*words, str(other)]).exit_code == 0
    assert out.read_bytes() != other.read_bytes()


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--run", "office", "--over", "steps"], "minutes or updates"),
        (["--run", "nothing"], "does not exist"),
        (["--run", "office", "--line", "greedy"], "NAME=METRES"),
        (["--run", "office", "--line", "greedy=261", "--by-family"], "leave it out"),
        (["--run", "office", "--out", "curve.xyz"], "cannot write"),
    ],
)
def test_what_cannot_be_drawn_is_explained(runs, words, reason):
    result = CliRunner().invoke(app, ["plot", "--runs", str(runs), *words])
    assert result.exit_code == 1
    assert reason in result.stderr
