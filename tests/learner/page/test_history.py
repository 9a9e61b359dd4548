import dataclasses
import json

from learner.page.history import read_evaluations, read_points
from learner.watch.metrics import Curves
from tests.learner.experience import episode_report


def test_the_curves_of_a_run_are_read_as_tensorboard_shows_them(tmp_path):
    folder = tmp_path / "tensorboard"
    with Curves(folder) as curves:
        for update in (10, 20, 30):
            curves.write(update, {"loss/critic": update / 10, "collect/steps": 1.0, "time/updates_per_second": 4.0})
        curves.text("configuration", "{}")
    with Curves(folder, update=20) as curves:
        curves.write(30, {"loss/critic": 33.0})
        curves.write(40, {"evaluation/distance": 250.5})
    damaged = sorted(folder.iterdir())[-1]
    damaged.write_bytes(damaged.read_bytes() + b"\x40\x00\x00")
    points = read_points(tmp_path)
    assert [point.updates for point in points] == [10, 20, 30, 40]
    assert [point.values.get("loss/critic") for point in points] == [1.0, 2.0, 33.0, None]
    assert set(points[0].values) == {"loss/critic", "time/updates_per_second"}
    assert points[3].values == {"evaluation/distance": 250.5}
    assert read_points(tmp_path / "elsewhere") == []


def test_evaluations_are_found_among_the_episodes(tmp_path):
    lines = [
        json.dumps({"time": 1.0, "actor": "desk-0", "updates": 5, **dataclasses.asdict(report)})
        for report in (episode_report(), episode_report(role="evaluate", map_name="rooms-3"))
    ]
    (tmp_path / "episodes.jsonl").write_text("\n".join([*lines, "nonsense", ""]))
    assert [line["map_name"] for line in read_evaluations(tmp_path)] == ["rooms-3"]
    assert list(read_evaluations(tmp_path / "elsewhere")) == []
