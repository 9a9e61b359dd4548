import json
import os
import re

import pytest

from actors.evaluation.journal import Journal
from actors.evaluation.outcome import Place, crashed
from actors.evaluation.results import ResultsError, read_results
from actors.evaluation.runner import Evaluation
from actors.evaluation.worker import Worker
from actors.maps.ros_map import read_map_server_file
from common.errors import CheckpointError, ConfigError, MapError
from tests.actors.evaluation.small import settings
from tests.actors.maps.ros_files import room, write_ros

OWN = "tests.actors.evaluation.small"


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A greedy planner and the reference on two worlds, by one real worker process."""
    out = tmp_path_factory.mktemp("results")
    seen = []
    with Evaluation(settings(), ["greedy", "omniscient"], out) as evaluation:
        evaluation.run(1, seen.append)
    return out, seen, evaluation


def test_each_planner_gets_a_results_file(done):
    out, seen, evaluation = done
    assert len(seen) == 4
    assert evaluation.crashes() == {}
    greedy, omniscient = (read_results(out / f"{name}.json") for name in ("greedy", "omniscient"))
    assert [episode.map for episode in greedy.episodes] == [episode.map for episode in omniscient.episodes]
    assert all(episode.success for episode in greedy.episodes + omniscient.episodes)
    for planned, best in zip(greedy.episodes, omniscient.episodes, strict=True):
        assert planned.steps == len(planned.waypoints) - 1
        assert best.distance_m <= planned.distance_m + 1e-6
        assert planned.decision_ms.p95 >= planned.decision_ms.median > 0.0


def test_a_finished_run_does_nothing_again(done):
    out, _, _ = done
    before = (out / "greedy.json").read_text()
    seen = []
    with Evaluation(settings(), ["greedy"], out) as again:
        assert again.done("greedy") == 2
        again.run(1, seen.append)
    assert seen == []
    assert (out / "greedy.json").read_text() == before


def test_maps_that_changed_since_the_results_are_warned_of(tmp_path):
    path = write_ros(tmp_path / "plan.yaml", room(240, 160), resolution=0.1, origin=[-5.0, -4.0, 0.0])
    mine = settings(maps=(f"{path}?start=-2.5,3.0",), limit=None)
    with Evaluation(mine, ["greedy"], tmp_path / "out") as evaluation:
        evaluation.run(1)
        assert evaluation.maps_warning() == ""
    with Evaluation(mine, ["greedy"], tmp_path / "out") as again:
        assert again.maps_warning() == ""
    image = read_map_server_file(path).image
    later = image.stat().st_mtime + 1000.0
    os.utime(image, (later, later))
    with Evaluation(mine, ["greedy"], tmp_path / "out") as again:
        assert again.maps_warning() == "", "it is written anew, and is the same"
    journal = tmp_path / "out" / "greedy.jsonl"
    recorded = journal.read_text()
    journal.write_text(re.sub(r'"map": "[0-9a-f]+", ', "", recorded))
    with Evaluation(mine, ["greedy"], tmp_path / "out") as again:
        assert image.name in again.maps_warning(), "an earlier version did not note what it held"
    journal.write_text(recorded)
    write_ros(tmp_path / "other.yaml", room(240, 180), image="other.pgm")
    os.utime(tmp_path / "other.pgm", (0.0, 0.0))
    (tmp_path / "other.pgm").rename(image)
    with Evaluation(mine, ["greedy"], tmp_path / "out") as again:
        assert image.name in again.maps_warning() and "--overwrite" in again.maps_warning()
    with Evaluation(mine, ["greedy"], tmp_path / "out", overwrite=True) as again:
        assert again.maps_warning() == ""


def test_a_start_that_changed_since_the_results_is_warned_of(tmp_path):
    write_ros(tmp_path / "plan.yaml", room(240, 160), resolution=0.1, origin=[-5.0, -4.0, 0.0])
    places = tmp_path / "worlds.toml"
    places.write_text('[worlds."plan.yaml"]\nstart = [-2.5, 3.0]\n')
    mine = settings(maps=(str(tmp_path),), limit=None)
    with Evaluation(mine, ["greedy"], tmp_path / "out") as evaluation:
        evaluation.run(1)
    places.write_text('# The same place.\n[worlds."plan.yaml"]\nstart = [-2.5, 3]\n')
    with Evaluation(mine, ["greedy"], tmp_path / "out") as again:
        assert again.maps_warning() == ""
    places.write_text('[worlds."plan.yaml"]\nstart = [-2.0, 3.0]\n')
    with Evaluation(mine, ["greedy"], tmp_path / "out") as again:
        assert "worlds.toml changed after results" in again.maps_warning()


def test_other_settings_do_not_mix(done):
    out, _, _ = done
    with pytest.raises(ResultsError, match="seed: 0 in the results, 1 now"):
        Evaluation(settings(seed=1), ["greedy"], out)


def test_one_process_a_core_counts_the_cores_that_are_there_for_this_process(tmp_path, monkeypatch):
    """A container or a job of a scheduler has few of its machine's cores."""
    workers = []
    monkeypatch.setattr(os, "cpu_count", lambda: 64)
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0}, raising=False)
    monkeypatch.setattr(Evaluation, "_work", lambda self, waiting, count, watch, warn: workers.append(count))
    with Evaluation(settings(), ["greedy"], tmp_path) as evaluation:
        evaluation.run(0)
    assert workers == [1]


def test_a_label_names_a_planner_in_its_results(tmp_path, done):
    with Evaluation(settings(), ["greedy"], tmp_path, label="mine") as evaluation:
        evaluation.run(1)
    greedy, mine = read_results(done[0] / "greedy.json"), read_results(tmp_path / "mine.json")
    assert mine.planner == "mine"
    assert [episode.waypoints for episode in mine.episodes] == [episode.waypoints for episode in greedy.episodes]
    with pytest.raises(ResultsError, match="planner: 'greedy' in the results, 'nearest' now"):
        Evaluation(settings(), ["nearest"], tmp_path, label="mine")
    with pytest.raises(ConfigError, match=r"names one planner, got 2 \(greedy, nearest\)"):
        Evaluation(settings(), ["greedy", "nearest"], tmp_path, label="mine")
    with pytest.raises(ConfigError, match="lower-case letters"):
        Evaluation(settings(), ["greedy"], tmp_path, label="../mine")


def test_another_policy_in_the_same_file_is_another_setting(tmp_path):
    policy = tmp_path / "policy.safetensors"
    prints = []
    for weights in (b"one", b"other"):
        policy.write_bytes(weights)
        prints.append([settings(policy=str(policy)).fingerprint(name)["policy"] for name in ("hdplanner", "greedy")])
    (one, none), (other, _) = prints
    assert one != other
    assert one.startswith("sha256:") and none is None
    assert settings().fingerprint("hdplanner")["policy"].startswith("sha256:")


def test_two_runs_of_a_planner_do_not_share_a_folder(tmp_path):
    with Evaluation(settings(), ["greedy", "nearest"], tmp_path):
        for overwrite in (False, True):
            with pytest.raises(ResultsError, match=r"another run \(process \d+\) evaluates planner 'nearest'.*--out"):
                Evaluation(settings(), ["nearest"], tmp_path, overwrite=overwrite)
        # Other planners' files are their own, and a run that is refused holds none of them.
        with pytest.raises(ResultsError, match="'greedy'"):
            Evaluation(settings(), ["omniscient", "greedy"], tmp_path)
        Evaluation(settings(), ["omniscient"], tmp_path).close()
    Evaluation(settings(), ["nearest"], tmp_path).close()


def test_a_run_that_is_refused_gives_the_folder_back(done):
    out, _, _ = done
    with pytest.raises(ResultsError, match="other settings"):
        Evaluation(settings(seed=1), ["greedy"], out)
    Evaluation(settings(), ["greedy"], out).close()


def test_episodes_depend_on_the_seed_alone(done):
    out, _, _ = done
    worker = Worker(settings(), lambda event, place: None)
    outcome = worker.run("greedy", 1)
    worker.close()
    episode = read_results(out / "greedy.json").episodes[1]
    assert outcome.waypoints == episode.waypoints
    assert outcome.distance == pytest.approx(episode.distance_m, abs=1e-3)


def test_a_fault_of_a_planner_costs_its_episode_alone():
    told = []
    worker = Worker(settings(time_limit=0.1), lambda event, place: told.append((event, place)))
    raised = worker.run(f"{OWN}:RaisingPlanner", 0)
    assert raised.crashed
    assert raised.reason == "RuntimeError: a fault in the planner"
    assert (raised.steps, len(raised.waypoints)) == (2, 3)
    assert raised.distance > 0.0
    assert 0.0 < raised.explored < 1.0
    assert [event for event, _ in told] == [
        "warm",
        "start",
        *("decide", "drive", "moved") * 2,
        "decide",
    ]
    cheated = worker.run(f"{OWN}:CheatingPlanner", 0)
    assert cheated.crashed
    assert "one edge" in cheated.reason
    slow = worker.run(f"{OWN}:SlowPlanner", 0)
    assert not slow.crashed
    assert not slow.success
    assert "the limit is 0.1 s" in slow.reason
    fine = worker.run("nearest", 0)
    assert fine.success
    worker.close()


@pytest.mark.slow
def test_processes_that_die_or_hang_are_replaced(tmp_path):
    planners = [f"{OWN}:DyingPlanner", f"{OWN}:HangingPlanner", "greedy"]
    with Evaluation(settings(limit=1, time_limit=1.0), planners, tmp_path) as evaluation:
        evaluation.run(1)
    crashes = evaluation.crashes()
    assert set(crashes) == set(planners[:2])
    assert "exit code 7" in crashes[planners[0]][0][1].reason
    assert "did not end" in crashes[planners[1]][0][1].reason
    died = read_results(evaluation.results_file(planners[0])).episodes[0]
    assert died.steps == 2
    assert not died.success
    assert read_results(tmp_path / "greedy.json").episodes[0].success
    # What crashed is run again, what ended well is not.
    with Evaluation(settings(limit=1, time_limit=1.0), planners, tmp_path) as again:
        assert [again.done(name) for name in planners] == [0, 0, 1]


def test_mistakes_are_found_before_the_work_starts(tmp_path):
    with pytest.raises(ConfigError, match="greedy"):
        Evaluation(settings(), ["gredy"], tmp_path)
    with pytest.raises(CheckpointError, match="cannot read the policy"):
        Evaluation(settings(policy="no.safetensors"), ["hdplanner"], tmp_path)
    with pytest.raises(ConfigError, match="exploration, not navigation"):
        Evaluation(settings(task={"name": "navigation"}), ["greedy"], tmp_path)
    with pytest.raises(ConfigError, match="MODULE:CLASS"):
        Evaluation(settings(), ["nowhere:Planner"], tmp_path)
    with pytest.raises(MapError, match="no such folder"):
        Evaluation(settings(maps=("nowhere/",)), ["greedy"], tmp_path)


def test_a_journal_survives_a_kill_and_tells_of_damage(tmp_path):
    path = tmp_path / "greedy.jsonl"
    outcome = crashed([Place(1.0, 2.0, 0.0, 0.1), Place(3.0, 2.0, 0.5, 0.2)], "a fault")
    good = Journal.open(path, {"seed": 0})
    good.add(0, outcome, "abc")
    fine = json.loads(path.read_text().splitlines()[1]) | {"crashed": False, "number": 1}
    path.write_text(path.read_text() + json.dumps(fine) + "\n" + '{"number": 2, "cut off')
    journal = Journal.open(path, {"seed": 0})
    assert list(journal.outcomes) == [1]
    assert journal.outcomes[1].waypoints == [(1.0, 2.0), (3.0, 2.0)]
    assert path.read_text().endswith("\n")
    journal.add(2, outcome, "def")
    assert Journal.open(path, {"seed": 0}).commits == ["abc"]
    path.write_text(path.read_text() + "[]\n")
    with pytest.raises(ResultsError, match="damaged"):
        Journal.open(path, {"seed": 0})
