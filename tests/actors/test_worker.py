"""A worker in this process against a real learner's end on a real bus."""

import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from actors.options import ActorOptions
from actors.worker import Worker
from common.config.schema import BusConfig
from common.messages.experience import Chunk, EpisodeReport
from tests.actors.learner_end import LearnerEnd, free_port


class Running:
    """A worker in a thread."""

    def __init__(self, endpoint, **options):
        self.stop = threading.Event()
        bus = BusConfig(connect=(endpoint,))
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
            assert learner.wait_for(lambda: running.worker._state == "held by the learner")
            learner.wait_for(lambda: False, timeout=0.5)
            counted = len(learner.deliveries)
            learner.wait_for(lambda: False, timeout=1.0)
            assert len(learner.deliveries) == counted


def test_a_learner_that_comes_back_is_served_again_and_a_new_configuration_taken(port):
    with Running(f"tcp/127.0.0.1:{port}") as running:
        with LearnerEnd(port) as first:
            assert first.wait_for(lambda: len(first.chunks()) >= 2)
            old = first.deliveries[0].incarnation
        assert not running.stop.wait(1.0)
        with LearnerEnd(port, task={"max_steps": 3}, network={"width": 48, "heads": 3, "layers": 1}) as second:

            def begun_anew() -> list[Chunk]:
                bodies = [delivery.body for delivery in second.deliveries if delivery.incarnation != old]
                return [body for body in bodies if isinstance(body, Chunk)]

            assert second.wait_for(lambda: any(chunk.first_step + chunk.steps == 3 for chunk in begun_anew()))
            steps = begun_anew()
            assert max(chunk.first_step + chunk.steps for chunk in steps) <= 3
            assert np.all([chunk.steps <= 3 for chunk in steps])
