import json
import logging
import shutil
import threading
import time

import numpy as np
import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from common.errors import CheckpointError, HDError
from common.policies.policy import Policy
from common.policies.policy_file import read_policy
from learner.loop import train
from learner.run.checkpoints import CheckpointStore
from learner.run.export import export_policy
from learner.run.folder import RunFolder
from learner.run.records import scan
from tests.learner.experience import deliver, episode_report
from tests.learner.runs import POOL, PPO, episodes, make_trainer, small_config, train_some


def new_run(tmp_path, **changes):
    return RunFolder.create(tmp_path, small_config(**changes))


def everything(trainer):
    tensors, values = trainer.algorithm.state()
    return {name: tensor.numpy().tobytes() for name, tensor in tensors.items()}, values


def curve(run, name):
    accumulator = EventAccumulator(str(run.tensorboard))
    accumulator.Reload()
    return {event.step: event.value for event in accumulator.Scalars(name)}


@pytest.mark.parametrize(("changes", "loss"), [({}, "loss/critic"), (PPO, "loss/surrogate")], ids=["sac", "ppo"])
def test_a_resumed_run_goes_on_with_the_same_curves(tmp_path, changes, loss):
    """Save, load and 12 updates more give bit for bit what 24 updates in one go give."""
    made = episodes(8, labelled=bool(changes))
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    with new_run(tmp_path / "one", **changes) as run:
        whole, _ = make_trainer(run)
        whole.begin()
        for delivery in made:
            whole.ingest.store(delivery)
        expected = train_some(whole, 24)
        state = everything(whole)
        whole.close()
    with new_run(tmp_path / "two", **changes) as run:
        first, _ = make_trainer(run)
        first.begin()
        for delivery in made:
            first.ingest.store(delivery)
        before = train_some(first, 12)
        first.checkpoint()
        train_some(first, 5)  # lost with the process, and made again
        first.close()
    with RunFolder.open(tmp_path / "two", "test") as run:
        second, _ = make_trainer(run)
        second.resume()
        after = train_some(second, 12)
        assert before + after == expected
        assert everything(second) == state
        second.close()
        resumed = curve(run, loss)
    with RunFolder.open(tmp_path / "one", "test") as run:
        assert resumed == curve(run, loss)


def test_versions_go_on_rising_after_a_kill(tmp_path):
    with new_run(tmp_path) as run:
        trainer, published = make_trainer(run)
        trainer.begin()
        for delivery in episodes(4):
            trainer.ingest.store(delivery)
        trainer.publish()
        train_some(trainer, 20)
        assert [version.version for version in published] == [1, 2, 3, 4, 5]
        trainer.close()  # no checkpoint: what is newer than the first one is in the journal alone
    with RunFolder.open(tmp_path, "test") as run:
        again, published = make_trainer(run)
        again.resume()
        again.publish()
        assert published[-1].version == 6
        assert again.limiter.steps == 32 and again.limiter.updates == 0
        assert again.ingest.episode_count == 4
        again.close()


def test_a_damaged_newest_checkpoint_costs_updates_but_no_data(tmp_path, caplog):
    with new_run(tmp_path) as run:
        trainer, _ = make_trainer(run)
        trainer.begin()
        made = episodes(6)
        for part in range(3):
            for delivery in made[part * 6 : part * 6 + 6]:
                trainer.ingest.store(delivery)
            train_some(trainer, 4)
            trainer.checkpoint()
        trainer.close()
        path = run.checkpoints / "000000012" / "tensors.safetensors"
        path.write_bytes(path.read_bytes()[:-1])
    with RunFolder.open(tmp_path, "test") as run:
        again, _ = make_trainer(run)
        again.resume()
        assert "000000012 is damaged" in caplog.text
        assert again.limiter.updates == 8
        assert again.limiter.steps == 48
        assert again.ingest.episode_count == 6 == len(run.episodes.read_text().splitlines())
        again.checkpoint()
        again.close()
        assert (run.checkpoints / "damaged-000000012").is_dir()


def test_who_asks_a_run_that_has_ended_for_a_checkpoint_is_answered_with_that_of_the_end(tmp_path):
    with new_run(tmp_path) as run:
        trainer, _ = make_trainer(run)
        trainer.begin()
        for delivery in episodes(2):
            trainer.ingest.store(delivery)
        trainer.stop()
        train(trainer)
        began = time.monotonic()
        assert trainer.request_checkpoint(30.0)
        assert time.monotonic() - began < 15.0
        trainer.close()


@pytest.mark.parametrize("again", ["start", "resume"])
def test_a_run_without_a_checkpoint_begins_again_with_its_journal(tmp_path, again):
    with new_run(tmp_path) as run:
        trainer, _ = make_trainer(run)
        trainer.begin()
        for delivery in episodes(3):
            trainer.ingest.store(delivery)
        trainer.publish()
        trainer.close()
        shutil.rmtree(run.checkpoints)
    with RunFolder.open(tmp_path, "test") if again == "resume" else new_run(tmp_path) as run:
        trainer, published = make_trainer(run)
        trainer.resume() if again == "resume" else trainer.begin()
        assert (trainer.limiter.steps, trainer.ingest.episode_count, len(trainer.replay)) == (24, 3, 24)
        for delivery in episodes(3):
            trainer.ingest.store(delivery)
        trainer.publish()
        assert (trainer.limiter.steps, published[-1].version) == (24, 2)
        assert trainer.checkpoints.names() == ["000000000"]
        trainer.close()
        assert len(run.episodes.read_text().splitlines()) == 3


def test_one_bad_bit_in_the_newest_segment_costs_one_delivery_and_is_told(tmp_path, caplog):
    with new_run(tmp_path) as run:
        trainer, _ = make_trainer(run)
        trainer.begin()
        for delivery in episodes(20):
            trainer.ingest.store(delivery)
        trainer.close()
        (segment,) = run.journal.iterdir()
        content = bytearray(segment.read_bytes())
        # The first chunk of the second episode.
        place = [found.start for found in scan(segment)][3]
        content[place + 200] ^= 1
        segment.write_bytes(content)
    with RunFolder.open(tmp_path, "test") as run:
        trainer, _ = make_trainer(run)
        trainer.resume()
        assert (trainer.limiter.steps, trainer.ingest.episode_count) == (20 * 8 - 4, 20)
        assert "record 3 (damaged)" in caplog.text
        assert "deliveries that the damage has cost: desk-0 (incarnation 7) 3 to 3" in caplog.text
        train_some(trainer, 2)
        trainer.close()


def test_a_change_that_cannot_be_continued_with_leaves_the_run_as_it_was(tmp_path, monkeypatch):
    with new_run(tmp_path) as run:
        trainer, _ = make_trainer(run)
        trainer.begin()
        trainer.close()
    monkeypatch.setattr("learner.run.folder.check_change", lambda before, after: None)
    with RunFolder.open(tmp_path, "test") as run:
        run.reconfigure(small_config(network={"width": 32}))
        again, _ = make_trainer(run)
        with pytest.raises(HDError, match=r"encoder\.embedding"):
            again.resume()
        again.close()
    with RunFolder.open(tmp_path, "test") as run:
        assert run.config.network.width == 16
        assert not list(run.path.glob("config.*.json"))
        run.reconfigure(small_config(learner={"total_updates": 7}))
        again, _ = make_trainer(run)
        again.resume()
        again.close()
    with RunFolder.open(tmp_path, "test") as run:
        assert run.config.learner.total_updates == 7


def test_learning_waits_for_labels_that_a_changed_configuration_asks_for(tmp_path, caplog):
    with new_run(tmp_path) as run:
        trainer, _ = make_trainer(run)
        trainer.begin()
        for delivery in episodes(2):
            trainer.ingest.store(delivery)
        trainer.checkpoint()
        trainer.close()
    with RunFolder.open(tmp_path, "test") as run:
        run.reconfigure(small_config(sac={"privileged_critic": True}, reward={"kind": "potential"}))
        again, _ = make_trainer(run)
        again.resume()
        assert len(again.replay) and not again.data_is_ready()
        assert "learning waits" in caplog.text
        for delivery in episodes(2, actor="desk-1", labelled=True):
            again.ingest.store(delivery)
        train_some(again, 1)
        again.close()


def test_the_loop_keeps_the_ratio_publishes_and_ends_with_a_checkpoint(tmp_path):
    changes = {"updates_per_step": 0.5, "total_updates": 16, "publish_every": 4}
    with new_run(tmp_path, learner=changes) as run:
        trainer, published = make_trainer(run)
        trainer.begin()
        for delivery in episodes(4):
            trainer.ingest.store(delivery)
        train(trainer)
        assert trainer.complete and trainer.limiter.updates == 16
        assert [version.updates for version in published] == [0, 4, 8, 12, 16]
        assert trainer.checkpoints.pointer("last") == "000000016"
        assert not trainer.limiter.may_update()
        trainer.close()
        for name in ("loss/critic", "ratio/actual", "replay/transitions", "collect/steps", "episode_train/distance"):
            assert sorted(curve(run, name)) == [10, 16]


def test_versions_wait_while_many_actors_fetch_the_last_one(tmp_path):
    changes = {"updates_per_step": 0.5, "total_updates": 16, "publish_every": 4, "publish_seconds_per_actor": 1.0}
    with new_run(tmp_path, learner=changes) as run:
        trainer, published = make_trainer(run)
        trainer.begin()
        for delivery in episodes(4):
            trainer.ingest.store(delivery)
        trainer.publish()
        trainer.receivers = 1000
        train_some(trainer, 9)
        assert [version.updates for version in published] == [0]
        trainer.receivers = 0
        trainer.serve()
        trainer.serve()
        assert [version.updates for version in published] == [0, 9]
        trainer.receivers = 1000
        train_some(trainer, 7)
        assert [version.updates for version in published] == [0, 9, 16]
        trainer.close()


def test_a_diverged_update_ends_the_run_and_keeps_the_last_checkpoint(tmp_path):
    with new_run(tmp_path) as run:
        trainer, _ = make_trainer(run)
        trainer.begin()
        for delivery in episodes(2):
            trainer.ingest.store(delivery)
        with torch.no_grad():
            next(iter(trainer.algorithm.critic.parameters())).fill_(float("nan"))
        with pytest.raises(HDError, match=r"update 1 has diverged.*19 batches before.*lower the learning rates"):
            train(trainer)
        assert trainer.checkpoints.names() == ["000000000"]
        trainer.close()


@pytest.mark.parametrize("changes", [{}, {"sac": {"huber_delta": None}}, PPO], ids=["huber", "square", "ppo"])
def test_one_bad_value_ends_no_run_and_its_source_is_named(tmp_path, caplog, changes):
    """A reward that an earlier release let through, or that no bound will ever catch."""
    with new_run(tmp_path, learner={"total_updates": 12}, **changes) as run:
        trainer, published = make_trainer(run)
        trainer.begin()
        made = episodes(3, labelled="algorithm" in changes)
        made[1].body.rewards[2] = np.float32(np.inf)
        for delivery in made:
            trainer.ingest.store(delivery)
        train(trainer)
        assert trainer.complete
        assert "permanently excluded: message 1 of desk-0 (incarnation 7)" in caplog.text
        assert (made[1].actor, 7, 1) in trainer.ingest.quarantine
        assert all(np.isfinite(weights).all() for weights in published[-1].weights.values())
        trainer.close()


def test_cloning_waits_for_labels_and_says_so(tmp_path, caplog):
    with new_run(tmp_path, cloning={"updates": 5}) as run:
        trainer, _ = make_trainer(run)
        trainer.begin()
        for delivery in episodes(2):
            trainer.ingest.store(delivery)
        assert not trainer.data_is_ready()
        assert not trainer.data_is_ready()
        assert caplog.text.count("learning waits") == 1
        trainer.close()


def test_the_best_policy_is_chosen_by_complete_rounds_and_exported(tmp_path, caplog):
    caplog.set_level(logging.INFO)
    with new_run(tmp_path) as run:
        trainer, published = make_trainer(run)
        trainer.begin()
        for delivery in episodes(4):
            trainer.ingest.store(delivery)
        trainer.publish()
        train_some(trainer, 10)
        rounds = {1: (300.0, 1.0), 2: (250.0, 1.0), 3: (200.0, 0.5)}
        for version, (distance, success) in rounds.items():
            bodies = [
                episode_report("evaluate", version, map_name="a", distance=distance, success=True),
                episode_report("evaluate", version, map_name="b", distance=distance, success=success == 1.0),
            ]
            for delivery in deliver(bodies, actor=f"eval-{version}"):
                trainer.ingest.store(delivery)
            trainer.serve()
        assert trainer.best.version == 2
        trainer.checkpoint()
        trainer.close()
    card = export_policy(run.path, "best", tmp_path / "best.safetensors")
    assert (card.version, card.updates, card.evaluation["distance"]) == (2, 5, 250.0)
    policy, read = read_policy(tmp_path / "best.safetensors")
    assert read == card
    assert json.loads((tmp_path / "best.json").read_text())["task"] == "exploration"
    averaged = published[1].averaged
    observation = POOL[0]
    expected = Policy(run.config.network, averaged).decide(observation, greedy=True, rng=np.random.default_rng(0))
    decision = policy.decide(observation, greedy=True, rng=np.random.default_rng(0))
    assert np.array_equal(decision.waypoint_probabilities, expected.waypoint_probabilities)
    last = export_policy(run.path, "last", tmp_path / "last.safetensors")
    assert last.updates == 10 and last.evaluation is None
    with RunFolder.open(tmp_path, "test") as run:
        again, _ = make_trainer(run)
        again.resume()
        assert again.best.version == 2
        again.close()


def test_a_damaged_policy_file_is_refused(tmp_path):
    with new_run(tmp_path) as run:
        trainer, _ = make_trainer(run)
        trainer.begin()
        trainer.close()
    path = tmp_path / "p.safetensors"
    export_policy(run.path, "last", path)
    CheckpointStore(run.path / "checkpoints", 3).save(99, {"export.x": torch.zeros(1)}, {})
    with pytest.raises(CheckpointError, match="000000099 describes no policy: export another one"):
        export_policy(run.path, "last", tmp_path / "other.safetensors")
    path.write_bytes(path.read_bytes()[:-4] + b"\0\0\0\1")
    with pytest.raises(CheckpointError, match="is damaged, or not the file"):
        read_policy(path)
    with pytest.raises(CheckpointError, match="cannot read the policy"):
        read_policy(tmp_path / "absent.safetensors")


def test_commands_reach_the_loop(tmp_path):
    with new_run(tmp_path) as run:
        trainer, _ = make_trainer(run)
        trainer.begin()
        for delivery in episodes(2):
            trainer.ingest.store(delivery)
        trainer.pause()
        loop = threading.Thread(target=train, args=(trainer,))
        loop.start()
        assert trainer.state == "paused"
        assert trainer.request_checkpoint(timeout=10.0)
        assert trainer.limiter.updates == 0
        trainer.unpause()
        deadline = time.monotonic() + 60.0
        while trainer.limiter.updates < 16 and time.monotonic() < deadline:
            time.sleep(0.02)
        assert trainer.limiter.updates == 16
        trainer.stop()
        loop.join(10.0)
        assert not loop.is_alive()
        assert trainer.checkpoints.names()[-1] == f"{trainer.limiter.updates:09d}"
        trainer.close()


def test_a_complete_run_waits_for_the_evaluation_of_its_final_policy(tmp_path):
    with new_run(tmp_path, learner={"total_updates": 4}) as run:
        trainer, published = make_trainer(run)
        trainer.begin()
        for delivery in episodes(2):
            trainer.ingest.store(delivery)
        reports = deliver([episode_report("evaluate", 1, map_name=name) for name in ("a", "b")], actor="eval-0")
        trainer.ingest.store(reports[0])
        loop = threading.Thread(target=train, args=(trainer,))
        loop.start()
        deadline = time.monotonic() + 60.0
        while not trainer.complete and time.monotonic() < deadline:
            time.sleep(0.02)
        loop.join(0.6)
        assert loop.is_alive()
        final = trainer.ingest.version
        last = deliver([episode_report("evaluate", final, map_name=name) for name in "ab"], actor="eval-1")
        for delivery in last:
            trainer.ingest.store(delivery)
        loop.join(30.0)
        assert not loop.is_alive()
        assert trainer.best.version == final == published[-1].version
        trainer.close()
