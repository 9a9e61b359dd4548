"""The paper's tables: what is claimed is judged from results, and a page says what is there and what is not."""

import dataclasses
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from actors.evaluation.packing import unpack
from actors.evaluation.results import EpisodeResult, Results, write_packed, write_results
from actors.maps.clear_space import clear_space
from actors.maps.connectivity import reachable
from actors.maps.sources import open_sources
from benchmarks.paper import page as pages
from benchmarks.paper import plan
from benchmarks.paper.ablation import ablation
from benchmarks.paper.claims import CLAIMS, drives, succeeds
from benchmarks.paper.curves import AT
from benchmarks.paper.plan import TABLES, TRAININGS, Place, Row, work
from benchmarks.paper.scenes import garden, laboratory, make_scenes, start_places
from benchmarks.paper.steps import Folders, StepError, Steps, read_costs
from common.config.load import load_config
from tests.plans import office_floor

RELEASE = Path(__file__).parents[2] / "release" / "paper"


def results(label, distances, success=True):
    episodes = [
        EpisodeResult(
            map=f"{number}.png",
            waypoints=[(0.0, 0.0)],
            distance_m=distance,
            steps=1,
            success=success,
            explored_rate=1.0,
            decision_ms={"median": 2.0, "p95": 3.0},
        )
        for number, distance in enumerate(distances)
    ]
    return Results(
        task="exploration",
        metres_per_pixel=0.25,
        sensor_range_m=20.0,
        planner=label,
        commit="c",
        seed=0,
        episodes=episodes,
    )


def folders(tmp_path):
    return Folders(tmp_path / "maps", tmp_path / "work", tmp_path / "release")


def test_a_ratio_holds_on_the_published_side_of_one_alone():
    tare = results("tare", [100.0, 110.0, 120.0, 130.0])
    shorter = [results(f"cnn-{seed}", [80.0 + seed, 88.0, 96.0, 104.0]) for seed in (0, 1)]
    found = {"exploration": [tare, *shorter, results("mixed", [90.0, 121.0, 130.0, 120.0])]}
    verdict = drives("exploration", "cnn", "tare", 0.9)(found)
    assert verdict.figure.startswith("0.801 (")
    assert verdict.words == "holds (2 of 3 seeds)"
    assert drives("exploration", "cnn", "tare", 1.056)(found).words.startswith("does not hold")
    assert drives("exploration", "mixed", "tare", 0.9)(found).words.startswith("not decided")
    # Two that are trained are compared by as many seeds as the one with fewer has.
    found["exploration"] += [results(f"ariadne-{seed}", [70.0, 80.0, 85.0, 90.0]) for seed in (0, 1, 2)]
    assert drives("exploration", "ariadne", "tare", 0.9)(found).words == "holds"
    assert drives("exploration", "ariadne", "cnn", 0.9)(found).words == "holds (2 of 3 seeds)"
    assert drives("exploration", "vanilla", "dsvp", 0.9)(found).words == "not finished: vanilla and dsvp"
    assert succeeds("exploration", "cnn", 0.9)(found).words == "holds"


def test_the_page_shows_what_is_there_and_names_what_is_not(tmp_path):
    here = folders(tmp_path)
    table = TABLES[0]
    for label, distances in (("tare", [100.0, 110.0]), ("greedy", [90.0, 105.0])):
        write_results(tmp_path / "one.json", results(label, distances))
        write_packed(tmp_path / "one.json", here.packed(table, Row(label, label)))
    copy = tmp_path / "paper.md"
    shutil.copyfile(pages.PAGE, copy)
    pages.write_page(here, copy)
    text = copy.read_text()
    assert "| greedy | 2 | 390.0 |" in text
    assert "`nearest` (not run)" in text
    assert "`hdplanner-0` (training: 0 of 3,000 updates)" in text
    assert "| hdplanner-exploration-0 | exploration | not begun | - |" in text
    assert text.count("not finished: ") >= len(CLAIMS) - 3
    pages.write_page(here, copy)
    assert copy.read_text() == text


def test_a_row_is_run_once_and_a_failure_is_named(tmp_path, monkeypatch):
    here = folders(tmp_path)
    options = ("--maps", "generator:rooms?width=256&height=192", "--limit", "1")
    table = dataclasses.replace(TABLES[0], options=options, rows=(Row("mine", "greedy"),))
    steps = Steps(here)
    place = Place(table, table.rows[0])
    assert not here.done(None, [place])
    steps.evaluate(place)
    assert here.done(None, [place]) and not here.done((TRAININGS[0], 1), [place])
    packed = here.packed(table, place.row)
    before, spent = packed.read_bytes(), read_costs(here)
    assert spent["exploration-mine"].core_hours > 0.0
    steps.evaluate(place)
    assert (packed.read_bytes(), read_costs(here)) == (before, spent)
    with pytest.raises(StepError, match=r"exploration-none failed with exit code 1: see .*exploration-none\.log"):
        steps.evaluate(Place(table, Row("none", "gredy")))
    steps.stop()
    with pytest.raises(StepError, match="stopped"):
        steps.evaluate(Place(table, Row("other", "greedy")))


def test_the_ablation_compares_the_means_of_seeds_with_everything_together(tmp_path):
    found = [results(f"hdplanner-{seed}", [100.0 + seed, 110.0 + seed, 130.0 + seed]) for seed in (0, 1, 2)]
    found += [results("vanilla-0", [111.1, 121.1, 143.1]), results("full-graph-1", [101.0, 111.0, 131.0])]
    rows = {line.split("|")[2].strip(): line for line in ablation({"exploration": found}).splitlines()[2:]}
    assert set(rows) == {"hdplanner", "vanilla", "full-graph"}
    assert "| 3 | 1 |" in rows["hdplanner"] and "0.991, 1.000, 1.009 |" in rows["hdplanner"]
    assert "| 1 | 1.094 |" in rows["vanilla"]
    assert "| 1 | 1.000 | 1.000 to 1.000 | 1 |" in rows["full-graph"]
    assert ablation({"navigation": found[3:]}) == ""


def test_a_curve_takes_the_checkpoints_near_its_points_of_a_run_that_is_there(tmp_path):
    here = folders(tmp_path)
    training = TRAININGS[0]
    run = here.run(training.name, 1)
    for name in ("000000000", "000001260", "000001790", "000001900", "000002440", "000003000", "last"):
        (run / "checkpoints" / name).mkdir(parents=True)
    assert here.points_left(training, 1) == {}
    here.policy(training.name, 1).parent.mkdir(parents=True)
    here.policy(training.name, 1).touch()
    assert here.points_left(training, 1) == dict(
        zip(AT, ("000001260", "000001790", "000002440", "000003000"), strict=True)
    )
    (run / "checkpoints" / "000002440").rmdir()
    assert 2_400 not in here.points_left(training, 1)
    for at, factor in zip(AT, (1.3, 1.2, 1.0, 0.9), strict=True):
        write_results(tmp_path / "one.json", results(f"updates-{at}", [100.0 * factor, 110.0 * factor]))
        write_packed(tmp_path / "one.json", here.point(training.name, 1, at))
    assert here.points_left(training, 1) == {}
    shutil.rmtree(here.work)
    copy = tmp_path / "paper.md"
    shutil.copyfile(pages.PAGE, copy)
    pages.write_page(here, copy)
    assert f"| {training.name}-1 | 546.0 | 504.0 | 420.0 | 378.0 | 0.900 | 0.900 to 0.900 |" in copy.read_text()
    here.point(training.name, 1, 2_400).unlink()
    pages.write_page(here, copy)
    assert f"| {training.name}-1 | 546.0 | 504.0 | - | 378.0 | - |" in copy.read_text()


def test_what_is_kept_names_no_folder_of_the_machine_that_made_it():
    kept = [*RELEASE.rglob("*.json.xz"), *RELEASE.rglob("*.json")]
    assert kept
    for path in kept:
        data = unpack(path.read_bytes())
        assert not re.search(rb'"(?:/|[A-Z]:)[^"]*"', data), path


def test_everything_that_is_planned_can_be_begun(tmp_path):
    for training in TRAININGS:
        options = folders(tmp_path).filled(training.options(1))
        config = load_config(preset=options[1], overrides=options[3::2])
        assert (config.learner.total_updates, config.seed) == (plan.UPDATES, 1)
        assert config.task.name == training.task
    steps = [needs for needs, _ in work()]
    assert steps.index((TRAININGS[0], 1)) > max(k for k, needs in enumerate(steps) if needs is None or needs[1] == 0)
    ours = {"hdplanner", "hierarchical", "vanilla"}
    further = [needs[0].label in ours for needs in steps if needs is not None and needs[1] > 0]
    assert further == sorted(further, reverse=True)
    planned = [place for _, places in work() for place in places]
    assert sorted(map(repr, planned)) == sorted(repr(Place(table, row)) for table in TABLES for row in table.rows)


def test_scenes_leave_no_place_unreachable_and_start_far_apart(tmp_path):
    (tmp_path / "maps" / "cmu").mkdir(parents=True)
    world = office_floor().world
    for free in (laboratory(), garden()):
        scene = dataclasses.replace(world, free=free, start=(1.5, 1.5))
        clear, begin = clear_space(scene, 0.25)
        assert np.count_nonzero(reachable(clear, begin)) > 0.97 * np.count_nonzero(clear)
    places = np.array(start_places(world, 4))
    gaps = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    assert gaps[np.triu_indices(4, 1)].min() > 6.0
    with pytest.raises(Exception, match="hd-eval maps cmu"):
        make_scenes(tmp_path / "maps", tmp_path / "scenes")
    assert open_sources([str(tmp_path / "scenes" / "garden")], None, "exploration").world(0).start == (1.5, 1.5)
