"""What the learner tells Prometheus, and what the files of deploy/cluster ask for."""

import dataclasses
import json
import re
from pathlib import Path

import pytest

from common.messages.stats import ActorStats
from learner.run.episodes import EpisodeMeans
from learner.watch.prometheus import STATES, demand, learner_figures
from learner.watch.status import ActorStatus, LearnerStatus

CLUSTER = Path(__file__).parents[3] / "deploy" / "cluster"


def actor(name: str, role: str = "actor", alive: bool = True) -> ActorStatus:
    return ActorStatus(name, role, alive, "desk", 10.0, 100, 2, 3, 1, 0.5, 4, 0.1, "acting", 0, "")


def status(**changes) -> LearnerStatus:
    values = {field.name: 1 for field in dataclasses.fields(LearnerStatus)}
    values |= {"state": "training", "hold": 0.0, "ratio_declared": 0.0625, "losses": {}}
    values |= {"late": {"evaluate": EpisodeMeans(4, 261.0, 0.75, 0.99, 1.0, 20.0, 0.0)}}
    values |= {"actors": [actor("a-0"), actor("a-1"), actor("gone", alive=False), actor("e-0", "evaluator")]}
    return LearnerStatus(**(values | changes))


def test_a_scrape_tells_of_the_learner_and_of_those_who_are_there():
    figures = {figure.name: figure for figure in learner_figures(status(updates=7))}
    assert figures["hd_updates"].values == {(): 7.0} and figures["hd_updates"].kind == "counter"
    assert figures["hd_actors"].values == {("actor",): 2.0, ("evaluator",): 1.0}
    assert figures["hd_state"].values == {(state,): float(state == "training") for state in STATES}
    assert figures["hd_actor_steps_per_second"].values.keys() == {
        ("a-0", "actor"),
        ("a-1", "actor"),
        ("e-0", "evaluator"),
    }
    assert figures["hd_episode_success"].values == {("evaluate",): 0.75}
    assert all(re.fullmatch(r"hd_[a-z_]+", name) for name in figures)


def test_the_demand_grows_while_the_learner_waits_and_falls_while_actors_are_held():
    assert demand(status(state="waiting")) == 3.0
    assert demand(status()) == 2.0
    # It uses 10 updates a second, 160 steps; 320 come.
    assert demand(status(hold=1.0, updates_per_second=10.0, steps_per_second=320.0)) == 1.0
    assert demand(status(hold=1.0, updates_per_second=15.0, steps_per_second=320.0)) == 1.5
    assert demand(status(actors=[])) == 1.0


def test_every_figure_that_the_cluster_files_ask_for_exists():
    from actors.figures import actor_figures

    stats = ActorStats("a-0", "desk", 1, 10, 2, 3.0, 4, 5.0, 6, "acting")
    known = set()
    for figure in [*learner_figures(status()), *actor_figures(stats)]:
        known.add(figure.name + ("_total" if figure.kind == "counter" else ""))
    asked = {
        name
        for path in CLUSTER.rglob("*")
        if path.suffix in (".json", ".yaml", ".yml")
        for name in re.findall(r"\bhd_[a-z_]+\b", path.read_text())
    }
    assert asked
    assert asked <= known


@pytest.mark.parametrize("path", sorted(CLUSTER.rglob("*.json")), ids=lambda path: path.name)
def test_the_dashboard_is_one_that_grafana_reads(path):
    dashboard = json.loads(path.read_text())
    assert dashboard["title"] and dashboard["schemaVersion"] >= 30
    ids = [panel["id"] for panel in dashboard["panels"]]
    assert len(set(ids)) == len(ids) >= 8
    for panel in dashboard["panels"]:
        assert panel["targets"] and all(target["expr"] for target in panel["targets"])
        assert 0 <= panel["gridPos"]["x"] <= 24 - panel["gridPos"]["w"]
