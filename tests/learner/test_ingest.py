import json
import os
from dataclasses import replace

import numpy as np
import pytest

from common.bus import seen
from common.errors import CheckpointError, RefusedError
from common.messages.codec import pack
from common.messages.experience import Delivery, End
from common.messages.schema import encode
from learner.algorithm.base import NotFiniteError
from learner.ingest import Ingest
from learner.quarantine import STRIKES
from learner.rate_limiter import RateLimiter
from learner.replay.buffer import ReplayBuffer
from learner.run.episodes import EpisodeLog
from learner.run.journal import Journal
from learner.run.records import RecordKind
from learner.watch import actors
from tests.learner.experience import deliver, episode_chunks, episode_report, observation_pool
from tests.learner.runs import episodes, small_config


def open_ingest(folder, episodes_length=0, config=None):
    config = config or small_config()
    folder.mkdir(exist_ok=True)
    images = config.network.reads_image
    replay = ReplayBuffer(config.replay.capacity, config.replay.max_bytes, images=images, hints=config.hinted)
    limiter = RateLimiter(1.0, 100, 4)
    journal = Journal(folder / "journal")
    return Ingest(config, replay, limiter, journal, EpisodeLog(folder / "episodes.jsonl", episodes_length)), journal


def counts(ingest):
    return (ingest.limiter.steps, ingest.episode_count, len(ingest.replay), ingest.version, ingest.stored)


def lines(folder):
    return [json.loads(text) for text in (folder / "episodes.jsonl").read_text().splitlines()]


def samples(ingest):
    batch = ingest.replay.sample(50, np.random.default_rng(0))
    return batch.rewards.tolist(), batch.observations.neighbours.tolist()


def test_each_delivery_counts_once(tmp_path):
    ingest, journal = open_ingest(tmp_path)
    for delivery in episodes(3):
        ingest.store(delivery)
        ingest.store(delivery)
    assert counts(ingest)[:3] == (24, 3, 24)
    assert [line["distance"] for line in lines(tmp_path)] == [100.0, 101.0, 102.0]
    assert ingest.actors["desk-0"].steps == 24
    journal.close()


def test_observations_without_the_images_that_a_run_reads_are_refused(tmp_path):
    """And those with images that it does not read: both would end in the replay buffer, long after the reply."""
    graphs, pictures = small_config(), small_config(network={"variant": "cnn"})
    (delivery,) = episodes(1)[:1]
    body = delivery.body
    image = np.zeros((len(body.observations), 2, 48 * 48), dtype=np.uint8)
    drawn = replace(delivery, body=replace(body, observations=replace(body.observations, image=image)))
    for place, (config, taken, refused) in enumerate([(graphs, delivery, drawn), (pictures, drawn, delivery)]):
        ingest, journal = open_ingest(tmp_path / str(place), config=config)
        with pytest.raises(RefusedError, match=r"must have (an|no) image"):
            ingest.store(refused)
        ingest.store(taken)
        assert counts(ingest)[0] == body.steps
        journal.close()


def test_labels_without_the_hints_that_a_run_asks_for_are_refused(tmp_path):
    rng = np.random.default_rng(0)
    (chunk,) = episode_chunks(rng, observation_pool(size=5, image=True), 4, 4, End.TRUNCATED, labelled=True)
    gain = np.zeros(int(chunk.observations.count[:4].sum()), dtype=np.float32)
    hints = {"gain": gain, "truth": np.zeros((4, 2, 48 * 48), dtype=np.uint8)}
    plain, hinting = deliver([chunk, replace(chunk, labels=replace(chunk.labels, **hints))])
    network = {"belief_map": True}
    for weight, taken, refused in ((0.0, plain, hinting), (0.1, hinting, plain)):
        config = small_config(network=network, cloning={"updates": 1, "auxiliary_weight": weight})
        ingest, journal = open_ingest(tmp_path / str(weight), config=config)
        with pytest.raises(RefusedError, match=r"labels of this run must have (no )?hints"):
            ingest.store(refused)
        ingest.store(taken)
        drawn = ingest.replay.sample_labelled(3, rng).labels
        assert (drawn.gain is not None) == (weight > 0.0)
        journal.close()


def test_a_killed_learner_gets_everything_back_exactly(tmp_path):
    ingest, _ = open_ingest(tmp_path)
    made = episodes(10)
    for delivery in made[:14]:
        ingest.store(delivery)
    snapshot = json.loads(json.dumps(ingest.snapshot()))
    for delivery in made[14:]:
        ingest.store(delivery, encode(delivery))
    ingest.note_version(17)
    # No close: the process dies here.
    expected, drawn, written = counts(ingest), samples(ingest), lines(tmp_path)

    again, journal = open_ingest(tmp_path, snapshot["episodes_length"])
    again.rebuild(snapshot, updates=3)
    assert counts(again) == expected
    assert samples(again) == drawn
    assert [line["distance"] for line in lines(tmp_path)] == [line["distance"] for line in written]
    assert again.limiter.updates == 3
    for delivery in made:
        again.store(delivery)  # the actors send again what they have no acknowledgement for
    assert counts(again) == expected
    journal.close()


def test_deliveries_of_another_protocol_are_refused_with_advice(tmp_path):
    ingest, journal = open_ingest(tmp_path)
    ingest.store(episodes(1)[0])
    snapshot = ingest.snapshot()
    journal.append(RecordKind.DELIVERY, pack({"v": 1, "kind": "delivery"}))
    journal.close()
    again, journal = open_ingest(tmp_path, snapshot["episodes_length"])
    with pytest.raises(CheckpointError, match=r"cannot read .*must be 3.*got 1.*with the release that wrote it"):
        again.rebuild(snapshot, updates=0)
    journal.close()


def test_an_older_checkpoint_counts_the_same(tmp_path):
    ingest, _ = open_ingest(tmp_path)
    made = episodes(9)
    snapshots = []
    for part in range(3):
        for delivery in made[part * 9 : part * 9 + 9]:
            ingest.store(delivery)
        snapshots.append(ingest.snapshot())
    expected, drawn = counts(ingest), samples(ingest)
    for snapshot in reversed(snapshots):
        again, journal = open_ingest(tmp_path, snapshot["episodes_length"])
        again.rebuild(snapshot, updates=0)
        assert counts(again) == expected
        assert samples(again) == drawn
        assert len(lines(tmp_path)) == 9
        journal.close()


def test_segments_go_when_the_buffer_has_forgotten_them(tmp_path):
    config = small_config(replay={"capacity": 100})
    ingest, journal = open_ingest(tmp_path, config=config)
    snapshot = ingest.snapshot()
    for number, delivery in enumerate(episodes(80)):
        ingest.store(delivery)
        if number % 12 == 11:
            snapshot = ingest.snapshot()
            ingest.forget_before(snapshot["segment"])
    assert 3 <= len(journal.segments()) <= 6
    drawn = samples(ingest)
    again, journal = open_ingest(tmp_path, snapshot["episodes_length"], config)
    again.rebuild(snapshot, updates=0)
    assert samples(again) == drawn
    assert again.limiter.steps == 640
    journal.close()


def test_without_a_replay_snapshot_only_what_is_newer_comes_back(tmp_path):
    config = small_config(checkpoints={"replay": False}, replay={"min_steps": 8})
    ingest, _ = open_ingest(tmp_path, config=config)
    made = episodes(6)
    for delivery in made[:15]:
        ingest.store(delivery)
    snapshot = ingest.snapshot()
    ingest.forget_before(snapshot["segment"])
    again, journal = open_ingest(tmp_path, snapshot["episodes_length"], config)
    again.rebuild(snapshot, updates=2)
    assert (again.limiter.steps, len(again.replay)) == (40, 0)
    assert not again.limiter.may_update()
    for delivery in made[15:]:
        again.store(delivery)
    assert again.limiter.steps == 48
    assert again.limiter.may_update()
    journal.close()


def test_what_cannot_be_written_is_not_stored(tmp_path, monkeypatch):
    ingest, journal = open_ingest(tmp_path)
    first, second, *_ = episodes(1)
    ingest.store(first)

    def full_disk(descriptor, data):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "write", full_disk)
    with pytest.raises(CheckpointError, match="make room"):
        ingest.store(second)
    monkeypatch.undo()
    assert ingest.limiter.steps == 4
    ingest.store(second)
    assert ingest.limiter.steps == 8
    journal.close()


def test_an_unfinished_round_of_evaluation_survives(tmp_path):
    ingest, _ = open_ingest(tmp_path)
    ingest.note_version(6)
    reports = [episode_report("evaluate", 6, map_name=name, distance=200.0) for name in ("a", "b")]
    first, second = deliver(reports, actor="eval-0")
    ingest.store(first)
    snapshot = json.loads(json.dumps(ingest.snapshot()))
    again, journal = open_ingest(tmp_path, snapshot["episodes_length"])
    again.rebuild(snapshot, updates=0)
    assert again.versions_under_evaluation == {6}
    again.store(second)
    (finished,) = again.finished_rounds()
    assert (finished.version, finished.means.distance) == (6, 200.0)
    assert again.finished_rounds() == []
    journal.close()


def poison(delivery, reward=3e38):
    """A delivery as an earlier release has let it through."""
    delivery.body.rewards[1] = reward
    return delivery


def test_a_journal_with_poison_resumes_and_names_it(tmp_path, caplog):
    ingest, _ = open_ingest(tmp_path)
    snapshot = ingest.snapshot()
    first, second, *rest = episodes(3)
    for delivery in (first, poison(second), *rest):
        ingest.store(delivery)
    again, journal = open_ingest(tmp_path)
    again.rebuild(snapshot, updates=0)
    assert again.poisoned == 1
    assert again.limiter.steps == 20
    assert "set aside message 1 of 'desk-0' (incarnation 7)" in caplog.text
    assert "rewards: must be from -1e+06 to 1e+06, got 3e+38" in caplog.text
    # The sequence is free again, and nothing else was lost.
    assert again.stored == {("desk-0", 7): [(0, 1), (2, 9)]}
    journal.close()


def test_what_was_set_aside_stays_aside_and_counts_in_the_next_process(tmp_path):
    ingest, _ = open_ingest(tmp_path)
    made = episodes(3)
    for delivery in made:
        ingest.store(delivery)
    batch = ingest.replay.sample(50, np.random.default_rng(0))
    culprit = int(np.flatnonzero(batch.rewards == 1001.0)[0])
    ingest.quarantine.take(batch, NotFiniteError(["loss/critic"], np.array([culprit])), 1)
    assert len(ingest.replay) == 20
    assert not set(ingest.replay.sample(200, np.random.default_rng(0)).rewards) & {1000.0, 1001.0, 1002.0, 1003.0}
    snapshot = json.loads(json.dumps(ingest.snapshot()))
    again, journal = open_ingest(tmp_path, snapshot["episodes_length"])
    again.rebuild(snapshot, updates=0)
    assert (again.limiter.steps, len(again.replay)) == (24, 20)
    assert not set(again.replay.sample(200, np.random.default_rng(0)).rewards) & {1000.0, 1001.0, 1002.0, 1003.0}
    journal.close()


def test_an_actor_that_poisons_again_and_again_is_refused_and_the_others_are_not(tmp_path):
    ingest, journal = open_ingest(tmp_path)
    made = episodes(STRIKES, actor="evil-0")
    for delivery in made:
        ingest.store(delivery)
    for episode in range(STRIKES):
        ingest.store(made[0])  # known already, so it is acknowledged as before
        batch = ingest.replay.sample(300, np.random.default_rng(0))
        culprit = np.flatnonzero(batch.rewards == 1000.0 * episode + 1)[:1]
        ingest.quarantine.take(batch, NotFiniteError(["loss/critic"], culprit), 1)
    later = episodes(1, actor="evil-0", first=STRIKES)[0]
    refused = Delivery("evil-0", 8, 0, later.body)
    with pytest.raises(RefusedError, match="evil-0 is refused: 5 of its messages"):
        ingest.store(refused)
    ingest.store(episodes(1, actor="desk-0")[0])
    snapshot = json.loads(json.dumps(ingest.snapshot()))
    again, journal = open_ingest(tmp_path, snapshot["episodes_length"])
    again.rebuild(snapshot, updates=0)
    with pytest.raises(RefusedError):
        again.store(refused)
    journal.close()


def test_more_invented_names_than_are_remembered_make_no_replayed_message_count_twice(tmp_path, monkeypatch):
    monkeypatch.setattr(seen, "MAX_OPEN_PER_HOST", 200)
    monkeypatch.setattr(actors, "_MAX_ACTORS", 500)
    ingest, journal = open_ingest(tmp_path)
    honest = episodes(1)
    for delivery in honest:
        ingest.store(delivery)
    for number in range(550):
        ingest.store(Delivery(f"invented-{number}", number, 0, honest[-1].body))
    assert len(ingest.actors) == 500
    before = ingest.limiter.steps
    for delivery in honest:
        ingest.store(delivery)
    assert (ingest.limiter.steps, ingest.duplicates) == (before, len(honest))
    snapshot = json.loads(json.dumps(ingest.snapshot()))
    again, journal = open_ingest(tmp_path, snapshot["episodes_length"])
    again.rebuild(snapshot, updates=0)
    for delivery in honest:
        again.store(delivery)
    assert again.limiter.steps == before
    journal.close()


def test_evaluations_count_only_of_those_that_were_asked(tmp_path):
    config = small_config(learner={"evaluators": ["judge"]})
    ingest, journal = open_ingest(tmp_path, config=config)
    ingest.note_version(6)
    for actor in ("desk-0", "judge-eval-0"):
        for delivery in deliver([episode_report("evaluate", 6, map_name=name) for name in ("a", "b")], actor=actor):
            ingest.store(delivery)
        assert len(ingest.finished_rounds()) == (actor != "desk-0")
    journal.close()
