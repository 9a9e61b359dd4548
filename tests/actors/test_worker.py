"""A worker in this process against a real learner's end on a real bus."""

import logging
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest

from actors.options import ActorOptions
from actors.worker import Worker
from common.config import BusConfig
from common.errors import ConfigError, MapError
from common.messages.experience import Chunk, EpisodeReport
from tests.actors.learner_end import LearnerEnd, free_port
from tests.common.messages import samples


class Running:
    """A worker in a thread."""

    def __init__(self, *endpoints, **options):
        self.stop = threading.Event()
        bus = BusConfig(connect=endpoints)
        self.worker = Worker(ActorOptions(**{"name": "desk-0", "run": "test", "bus": bus, **options}), self.stop)
        self.pool = ThreadPoolExecutor(1)

    def __enter__(self):
        self.done = self.pool.submit(self.worker.run)
        return self

    def __exit__(self, *error):
        self.stop.set()
        self.done.result(timeout=20)
        self.pool.shutdown()


@pytest.fixture
def port():
    return free_port()


def test_an_actor_waits_for_its_learner_then_delivers_and_takes_new_weights(port):
    with Running(f"tcp/127.0.0.1:{port}"), LearnerEnd(port) as learner:
        assert learner.wait_for(lambda: len(learner.chunks()) >= 6)
        assert ("actor", "desk-0") in learner.presence.present()
        assert {int(v) for chunk in learner.chunks() for v in chunk.versions} == {1}
        learner.publish(7)
        assert learner.wait_for(lambda: learner.chunks()[-1].versions[-1] == 7)
        assert learner.wait_for(lambda: ("actor", "desk-0") in learner.stats.rows())
        row, _ = learner.stats.rows()["actor", "desk-0"]
        assert row.steps > 0
    assert all(count == 0 for count in learner.server.invalid.values())
    numbers = [delivery.sequence for delivery in learner.deliveries]
    assert sorted(numbers) == list(range(len(numbers)))


def test_chunks_come_with_labels_during_imitation_only(port):
    cloning = {"updates": 100, "expert_episodes": 0.5}
    with LearnerEnd(port, cloning=cloning) as learner, Running(learner.endpoint):
        assert learner.wait_for(lambda: len(learner.chunks()) >= 12)
        assert all(chunk.labels is not None for chunk in learner.chunks())
        drivers = {int(v) == -1 for chunk in learner.chunks() for v in chunk.versions}
        assert learner.wait_for(
            lambda: len({b.driver for b in (d.body for d in learner.deliveries) if isinstance(b, EpisodeReport)}) == 2
        ), drivers
        learner.publish(2, updates=100)
        assert learner.wait_for(lambda: any(chunk.labels is None for chunk in learner.chunks()))


def test_an_evaluator_runs_every_world_once_per_version(port):
    with LearnerEnd(port) as learner, Running(learner.endpoint, evaluate=True):

        def reports(version):
            bodies = [delivery.body for delivery in list(learner.deliveries)]
            return [body for body in bodies if isinstance(body, EpisodeReport) and body.version == version]

        assert learner.wait_for(lambda: len(reports(1)) == 2)
        learner.publish(2)
        assert learner.wait_for(lambda: len(reports(2)) == 2)
        assert learner.chunks() == []
        assert ("evaluator", "desk-0") in learner.presence.present()
    assert len(learner.deliveries) == 4
    assert {body.map_name for body in reports(1)} == {body.map_name for body in reports(2)}
    assert all(body.role == "evaluate" for body in reports(1))


def test_a_held_actor_pauses(port):
    with LearnerEnd(port) as learner:
        learner.hold = 60.0
        with Running(learner.endpoint) as running:
            assert learner.wait_for(lambda: len(learner.deliveries) >= 1)
            assert learner.wait_for(lambda: running.worker.state == "held by the learner")
            learner.wait_for(lambda: False, timeout=0.5)
            counted = len(learner.deliveries)
            learner.wait_for(lambda: False, timeout=1.0)
            assert len(learner.deliveries) == counted


def test_a_learner_that_comes_back_elsewhere_to_train_for_longer_gets_what_was_collected(port):
    other = free_port()
    with Running(f"tcp/127.0.0.1:{port}", f"tcp/127.0.0.1:{other}"):
        with LearnerEnd(port) as first:
            assert first.wait_for(lambda: len(first.chunks()) >= 2)
        with LearnerEnd(other, learner={"total_updates": 7}, checkpoints={"keep": 2}) as second:
            assert second.wait_for(lambda: len(second.chunks()) >= 20)
    assert {each.incarnation for each in second.deliveries} == {first.deliveries[0].incarnation}
    assert {each.sequence for each in [*first.deliveries, *second.deliveries]} >= set(range(20))


def test_a_learner_that_comes_back_is_served_again_and_a_new_configuration_taken(port):
    with Running(f"tcp/127.0.0.1:{port}") as running:
        with LearnerEnd(port) as first:
            assert first.wait_for(lambda: len(first.chunks()) >= 2)
            old = first.deliveries[0].incarnation
        assert not running.stop.wait(1.0)
        with LearnerEnd(port, task={"max_steps": 3}, network={"width": 16, "heads": 2, "layers": 2}) as second:

            def begun_anew() -> list[Chunk]:
                bodies = [delivery.body for delivery in second.deliveries if delivery.incarnation != old]
                return [body for body in bodies if isinstance(body, Chunk)]

            assert second.wait_for(lambda: any(chunk.first_step + chunk.steps == 3 for chunk in begun_anew()))
            steps = begun_anew()
            assert max(chunk.first_step + chunk.steps for chunk in steps) <= 3
            assert np.all([chunk.steps <= 3 for chunk in steps])


FOREIGN = """
import pathlib
pathlib.Path(__file__).with_name("imported").touch()
from dataclasses import replace
from actors.simulators.grid import GridSimulator
from common.tasks import EXPLORATION

class Simulator(GridSimulator): ...
TASK = replace(EXPLORATION, name="foreign-task")
"""


@pytest.fixture
def foreign(tmp_path, monkeypatch):
    """A module that Python finds on this machine, and that says when it is imported."""
    (tmp_path / "foreign_code.py").write_text(FOREIGN)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr("common.tasks._loaded", {})
    yield tmp_path / "imported"
    sys.modules.pop("foreign_code", None)


@pytest.mark.parametrize("evaluate", [False, True])
@pytest.mark.parametrize(
    "changes",
    [
        {"simulator": {"name": "foreign_code:Simulator"}},
        {"simulator": {"name": "grid"}, "task": {"name": "foreign_code:TASK"}},
        {"maps": {"train": ["generator:foreign_code:Maze"], "validation": ["generator:foreign_code:Maze"]}},
        {"families": [{"name": "a", "tasks": ["exploration", "foreign_code:TASK"]}]},
    ],
    ids=["simulator", "task", "maps", "families"],
)
def test_a_learner_cannot_make_an_actor_import_a_module(port, foreign, changes, evaluate):
    with LearnerEnd(port, **changes) as learner:
        bus = BusConfig(connect=(learner.endpoint,))
        options = ActorOptions(name="desk-0", run="test", bus=bus, evaluate=evaluate)
        with pytest.raises(ConfigError, match=r"foreign_code:.*start it with --allow MODULE:CLASS"):
            Worker(options, threading.Event()).run()
    assert not foreign.exists()
    assert "foreign_code" not in sys.modules


def test_an_actor_uses_the_modules_that_its_own_user_allows(port, foreign):
    changes = {
        "simulator": {"name": "foreign_code:Simulator"},
        "task": {"name": "foreign_code:TASK", "max_steps": 3},
    }
    allow = ("foreign_code:Simulator", "foreign_code:TASK")
    with LearnerEnd(port, **changes) as learner, Running(learner.endpoint, allow=allow):

        def reports():
            return [each.body for each in list(learner.deliveries) if isinstance(each.body, EpisodeReport)]

        assert learner.wait_for(lambda: len(reports()) >= 1)
        assert reports()[0].task == "foreign-task"
        assert reports()[0].simulator == "foreign_code:Simulator"
    assert foreign.exists()


def test_a_validation_world_that_cannot_be_used_is_left_out(caplog):
    class Evaluator:
        policy = SimpleNamespace(version=3)
        worlds = ("sound", "broken", "sound")

        def evaluate(self, index, keep_on):
            if self.worlds[index] == "broken":
                raise MapError(f"{index}.png: expected an image")
            return samples.report()

    worker = Worker(ActorOptions(name="a", run="r", bus=BusConfig()), threading.Event())
    parts = SimpleNamespace(collector=Evaluator(), left_out=set())
    with caplog.at_level(logging.INFO):
        worker._evaluate(parts)
        worker._evaluate(parts)
    assert caplog.text.count("left out a world: 1.png") == 1
    assert caplog.text.count("of 2 worlds complete") == 2
    parts.collector.worlds = ("broken",)
    with pytest.raises(MapError, match="no validation world can be used"):
        worker._evaluate(parts)
