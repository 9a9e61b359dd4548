import json

import pytest

from actors.collector import Collector
from common.config.load import load_config
from common.errors import ConfigError
from common.messages.experience import Chunk, EpisodeReport
from tests.actors.maps.images import simple

SMALL = "generator:rooms?width=192&height=192"
NETWORK = ["network.width=16", "network.heads=2", "network.layers=1"]


def collector_of(preset, *, role="train", overrides=()):
    delivered: list[Chunk | EpisodeReport] = []
    maps = [f"maps.train={SMALL}", f"maps.validation={SMALL}", "maps.validation_count=3"]
    config = load_config(preset=preset, overrides=[*maps, *NETWORK, *overrides])
    return Collector(config, [0, 0], delivered.append, role=role), delivered


def test_a_mix_of_worlds_serves_either_task():
    for task in ("exploration", "navigation"):
        collector, delivered = collector_of("mix", overrides=[f"task.name={task}"])
        report = collector.collect()
        collector.close()
        assert report is not None and (report.task, report.family) == (task, "rooms")
        chunks = [item for item in delivered if isinstance(item, Chunk)]
        assert sum(int(chunk.observations.route_count.sum()) for chunk in chunks) > 0


@pytest.mark.parametrize("preset", ["exploration", "navigation"])
def test_a_recipe_collects_labelled_steps_of_its_task(preset):
    collector, delivered = collector_of(preset)
    report = collector.collect()
    collector.close()
    assert report is not None
    assert report.task == preset
    chunks = [item for item in delivered if isinstance(item, Chunk)]
    assert sum(chunk.steps for chunk in chunks) == report.steps
    assert all(chunk.labels is not None for chunk in chunks)
    assert chunks[0].observations.has_target.all() == (preset == "navigation")


def test_the_recipe_for_both_tasks_gives_each_half_of_the_steps():
    collector, delivered = collector_of("both")
    reports = [collector.collect() for _ in range(6)]
    collector.close()
    steps = {task: sum(r.steps for r in reports if r.task == task) for task in ("exploration", "navigation")}
    longest = max(report.steps for report in reports)
    assert abs(steps["exploration"] - steps["navigation"]) <= longest
    with_target = {bool(item.observations.has_target[0]) for item in delivered if isinstance(item, Chunk)}
    assert with_target == {False, True}


def test_validation_of_both_tasks_has_worlds_of_both():
    collector, _ = collector_of("both", role="evaluate", overrides=["task.max_steps=2"])
    assert [arena.task for arena, _ in collector.worlds] == ["exploration"] * 2 + ["navigation"]
    tasks = [collector.evaluate(index).task for index in range(len(collector.worlds))]
    collector.close()
    assert tasks == ["exploration"] * 2 + ["navigation"]


def test_validation_worlds_of_one_name_are_told_apart(tmp_path):
    for name in "ab":
        (tmp_path / name).mkdir()
        simple(tmp_path / name / "1.png")
    folders = [str(tmp_path / name) for name in "ab"]
    maps = [f"maps.validation={json.dumps(folders)}", "maps.validation_count=2", "task.max_steps=1"]
    collector, delivered = collector_of("exploration", role="evaluate", overrides=maps)
    names = [collector.evaluate(index).map_name for index in (0, 1, 0, 1)]
    collector.close()
    assert names == ["1.png", "1.png (2)"] * 2
    assert [report.map_name for report in delivered] == names


@pytest.mark.parametrize(("role", "setting"), [("train", "maps.train"), ("evaluate", "maps.validation")])
def test_a_run_without_worlds_is_refused(role, setting):
    with pytest.raises(ConfigError, match=f"set {setting}, or `{setting[5:]}` of a family"):
        collector_of("exploration", role=role, overrides=[f"{setting}=[]"])


@pytest.mark.parametrize(
    ("overrides", "warned"),
    [
        (["maps.train=generator:office"], True),
        (["maps.train=generator:office", "task.max_steps=800"], False),
        (["maps.train=generator:office", "task.name=navigation"], False),
        ([], False),
    ],
)
def test_a_step_limit_that_the_worlds_exceed_is_named_at_the_start(overrides, warned, caplog):
    collector, _ = collector_of(None, overrides=["simulator.name=grid", *overrides])
    collector.close()
    assert ("128 decisions are likely to be too few for 4 of 4 worlds" in caplog.text) == warned
    assert ("--set task.max_steps=" in caplog.text) == warned


def test_unusable_maps_do_not_keep_a_warning_about_the_limit_from_being_given(tmp_path, caplog):
    simple(tmp_path / "good.png")
    (tmp_path / "worse.png").write_bytes(b"no image")
    collector, _ = collector_of(None, overrides=["simulator.name=grid", f"maps.train={tmp_path}"])
    collector.close()
    assert "likely to be too few" not in caplog.text
