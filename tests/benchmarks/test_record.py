"""Files of figures: what they hold, how two are compared, and the page that is made from one."""

import json
import re

import pytest

from benchmarks import __main__ as benchmarks
from benchmarks import compare
from benchmarks.blocks import END
from benchmarks.record import RATIOS, Record

FIGURES = {"inference": {"inference/small/torch_ms": 4.0, "inference/small/decision_ms": 2.0}, "replay": {"x_ms": 1.0}}
RATIO = "the policy through torch over compiled kernels, d 64"


def test_a_record_names_machine_commit_and_ratios(tmp_path):
    record = Record.of(FIGURES, 1.5)
    record.write(tmp_path / "build" / "bench.json")
    assert Record.read(tmp_path / "build" / "bench.json") == record
    held = json.loads((tmp_path / "build" / "bench.json").read_text())
    assert held["ratios"] == {RATIO: 2.0}
    assert "load 1.5" in held["machine"]
    assert re.match(r"[0-9a-f]{40}|unknown", held["commit"])


def test_a_comparison_shows_what_changed_and_counts_the_rest(tmp_path, capsys):
    paths = [tmp_path / "a.json", tmp_path / "b.json"]
    Record.of(FIGURES, 0.0).write(paths[0])
    inference = {"inference/small/torch_ms": 4.1, "inference/small/decision_ms": 1.0}
    Record.of({"inference": inference, "memory": {"learner MB": 1234.5}}, 0.0).write(paths[1])
    assert compare.main([str(path) for path in paths]) == 0
    told = capsys.readouterr().out
    lines = [re.split(r"\s{2,}", line.strip()) for line in told.splitlines()]
    assert ["inference", "inference/small/decision_ms", "2", "1", "0.50"] in lines
    assert ["ratios", RATIO, "2", "4.1", "2.05"] in lines
    assert "torch_ms" not in told, "it differs by 2.5 %"
    assert ["memory", "learner MB", "1,234"] in lines and ["replay", "x_ms", "1"] in lines
    assert "1 of 5 figures differ by less than 10%" in told


@pytest.mark.parametrize("content", [None, "{", "[1]", '{"machine": 1}'])
def test_another_file_is_refused_in_one_line(tmp_path, content, capsys):
    path = tmp_path / "x.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(SystemExit, match="2"):
        compare.main([str(path), str(path)])
    assert "expected a file of `make bench`" in capsys.readouterr().err


def test_the_page_is_made_from_a_file(tmp_path, monkeypatch):
    page = tmp_path / "speed.md"
    page.write_text(f"before\n\n{benchmarks.BEGIN}\n\nold\n\n{END}\nafter\n")
    monkeypatch.setattr(benchmarks, "PAGE", page)
    Record.of(FIGURES, 0.0).write(tmp_path / "bench.json")
    assert benchmarks.main(["--page", str(tmp_path / "bench.json")]) == 0
    text = page.read_text()
    assert text.startswith("before\n") and text.endswith("\nafter\n") and "old" not in text
    assert "| the replay buffer | x_ms | 1 |" in text
    assert f"| ratios within the run | {RATIO} | 2 |" in text


def test_ratios_are_of_figures_of_the_parts():
    assert {part for part, _, _ in RATIOS.values()} <= set(benchmarks.PARTS)
