import gzip
import json
import lzma

import pytest

from actors.evaluation.packing import LARGEST
from actors.evaluation.results import (
    ResultsError,
    collect_results,
    read_results,
    write_packed,
    write_results,
)
from tests.actors.evaluation.small import results


def test_a_results_file_has_the_published_format_and_reads_back(tmp_path):
    path = tmp_path / "greedy.json"
    write_results(path, results())
    data = json.loads(path.read_text())
    assert list(data) == [
        "task", "metres_per_pixel", "sensor_range_m", "units", "planner", "commit", "seed", "episodes",
    ]  # fmt: skip
    assert list(data["episodes"][0]) == [
        "map", "waypoints", "distance_m", "steps", "success", "explored_rate", "decision_ms", "corners",
        "reason", "unseen_m2",
    ]  # fmt: skip
    assert data["units"] == "px"
    assert data["episodes"][1]["waypoints"] == [[0.0, 0.0], [80.0, 0.0]]
    assert read_results(path) == results()


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"units": "m"}, "units"),
        ({"task": "my_module:TASK"}, "task"),
        ({"metres_per_pixel": 0}, "metres_per_pixel"),
        ({"episodes": [{}]}, "episodes.0"),
    ],
)
def test_what_breaks_the_format_is_named(tmp_path, change, word):
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(json.loads(results().model_dump_json()) | change))
    with pytest.raises(ResultsError, match=word):
        read_results(path)


def test_what_cannot_be_written_leaves_nothing_behind(tmp_path):
    (tmp_path / "nearest.json").mkdir()
    with pytest.raises(ResultsError, match="cannot write"):
        write_results(tmp_path / "nearest.json", results())
    assert [path.name for path in tmp_path.iterdir()] == ["nearest.json"]


def test_a_map_that_stands_twice_is_refused(tmp_path):
    path = tmp_path / "twice.json"
    data = json.loads(results().model_dump_json())
    data["episodes"].append(data["episodes"][0])
    path.write_text(json.dumps(data))
    with pytest.raises(ResultsError, match="more than once"):
        read_results(path)


@pytest.mark.parametrize("name", ["gzip", "xz"])
def test_packed_results_are_read_like_others_and_damage_is_named(tmp_path, name):
    write_results(tmp_path / "a.json", results("a"))
    packed = tmp_path / "kept" / "a.json.xz"
    write_packed(tmp_path / "a.json", packed)
    whole = packed.read_bytes()
    write_packed(tmp_path / "a.json", packed)
    assert packed.read_bytes() == whole
    compress = gzip.compress if name == "gzip" else lzma.compress
    whole = compress((tmp_path / "a.json").read_bytes())
    packed.write_bytes(whole)
    assert collect_results([tmp_path / "kept"]) == [results("a")]
    for damaged, word in (
        (whole[:-9], "cut off"),
        (whole[:20] + b"\xff\xfe\xfd" + whole[23:], f"no whole {name} file|cut off"),
        (b"version https://git-lfs.github.com/spec/v1\n", "it is a pointer of Git LFS"),
        (compress(bytes(LARGEST + 1), 1) if name == "gzip" else _many_zeros(), "more than 256 MiB"),
    ):
        packed.write_bytes(damaged)
        with pytest.raises(ResultsError, match=word):
            collect_results([packed])


def _many_zeros() -> bytes:
    """Return what unpacks to more than the largest file, joined, because xz takes seconds for it."""
    part = lzma.compress(bytes(1 << 24), preset=0)
    return part * (LARGEST // (1 << 24) + 1)


def test_results_are_unpacked_by_their_content(tmp_path):
    """Browsers unpack what they download, and tools that pack in parallel join several parts."""
    write_results(tmp_path / "a.json", results("a"))
    plain = (tmp_path / "a.json").read_bytes()
    for name, data in (
        ("unpacked.json.gz", plain),
        ("packed.json", gzip.compress(plain)),
        ("joined.json.gz", gzip.compress(plain[:50]) + gzip.compress(plain[50:])),
        ("other.json.gz", lzma.compress(plain)),
        ("parts.json.xz", lzma.compress(plain[:50]) + lzma.compress(plain[50:])),
    ):
        (tmp_path / name).write_bytes(data)
        assert read_results(tmp_path / name) == results("a")


def test_hidden_files_are_no_results(tmp_path):
    write_results(tmp_path / "a.json", results("a"))
    (tmp_path / "._a.json").write_bytes(b"\0\5\26\7")
    assert [found.planner for found in collect_results([tmp_path])] == ["a"]


def test_files_and_folders_are_collected(tmp_path):
    write_results(tmp_path / "a.json", results("a"))
    write_results(tmp_path / "b.json", results("b"))
    assert [found.planner for found in collect_results([tmp_path])] == ["a", "b"]
    assert [found.planner for found in collect_results([tmp_path / "b.json"])] == ["b"]
    with pytest.raises(ResultsError, match="hd-eval run"):
        collect_results([tmp_path / "none"])
    write_results(tmp_path / "c.json", results("a"))
    with pytest.raises(ResultsError, match="choose one"):
        collect_results([tmp_path])
    write_results(tmp_path / "c.json", results("c", task="navigation"))
    with pytest.raises(ResultsError, match="another task"):
        collect_results([tmp_path])
