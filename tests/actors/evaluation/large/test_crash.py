"""An episode that crashes costs no other one, and is run again."""

import pytest

pytest.importorskip("pybullet")

from actors.evaluation.journal import Journal
from actors.evaluation.large.robot import LIDAR
from actors.evaluation.settings import EvaluationSettings
from actors.evaluation.worker import Worker

SMALL = "generator:building?width=192&height=192&lobbies=1"


def test_a_crash_is_told_and_the_next_episode_runs_as_if_it_had_not_been(tmp_path):
    settings = EvaluationSettings(
        maps=(SMALL,), limit=2, task={"name": "exploration", "max_steps": 4}, simulator=LIDAR, large=True
    )
    worker = Worker(settings, lambda event, place: None)
    try:
        first = worker.run("greedy", 1)
        bad = worker.run("tests.actors.evaluation.small:RaisingPlanner", 0)
        again = worker.run("greedy", 1)
    finally:
        worker.close()
    assert bad.crashed
    assert "a fault in the planner" in bad.reason
    assert len(bad.waypoints) > 1 and bad.distance > 0.0
    assert not again.crashed and again.reason.startswith("step limit; ")
    assert (again.track, again.curve, again.volume) == (first.track, first.curve, first.volume)
    journal = Journal.open(tmp_path / "greedy.jsonl", settings.fingerprint("greedy"))
    journal.add(0, bad, "abc")
    journal.add(1, again, "abc")
    kept = Journal.open(tmp_path / "greedy.jsonl", settings.fingerprint("greedy")).outcomes
    assert list(kept) == [1]
    assert kept[1].distance == again.distance and len(kept[1].track) == len(again.track)
